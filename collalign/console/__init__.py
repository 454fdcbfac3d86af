"""What all commands share: what they print, how they end, and the arguments that several have.

* ``messages``: what they print, and for how long they have run
* ``streams``: closed, full, or read by nobody
* ``interruption``: Ctrl-C, SIGTERM, SIGHUP
* ``help``: grouped options
* ``running``: options of how a command runs
"""
