"""What all commands share at the shell: how they print, stop, and judge the places they write to."""
