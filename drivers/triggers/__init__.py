"""Drivers of output lines that give pulses to other machines."""
