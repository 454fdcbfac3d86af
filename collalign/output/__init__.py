"""Everything that leaves a run: files, report, exports, contact sheet, corrections."""
