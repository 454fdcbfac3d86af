"""What the module does apart from Slicer: runs the command, reads its results. Tested without Slicer."""
