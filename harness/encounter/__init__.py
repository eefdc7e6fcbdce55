"""A scenario and a pair's number in; the traces of an encounter or an hour out."""
