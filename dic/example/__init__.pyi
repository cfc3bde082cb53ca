from .copy import FILES as FILES, example_places as example_places, write_example as write_example
