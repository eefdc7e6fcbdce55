"""A scenario and a pair's number in; the traces of both arms of an encounter out."""
