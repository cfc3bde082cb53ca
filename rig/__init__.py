"""The experiment: protocol, plan, engine, recorder and commands."""
