"""Drivers for operators: people who do manual actions at the rig when the program asks for them."""
