"""The devices as they behave on the wire, and the specimen they see: the independent truth of every test."""
