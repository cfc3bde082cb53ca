"""What the drivers of GenICam cameras share: settings, trigger and output lines, clock and frame numbers."""
