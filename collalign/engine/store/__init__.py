"""Every finished task, kept so that an interrupted run can go on."""
