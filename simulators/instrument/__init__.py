"""Instruments that talk in lines of text, as meters, indicators of load and microcontrollers do."""
