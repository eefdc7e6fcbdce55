"""Observations of a vehicle's surroundings in; acceleration commands out.

Each strategy that ``registry`` lists has a module of its own.  The others are machinery: ``own``
and ``program`` load the user's strategies, ``parameters`` checks their tables, ``manoeuvres`` has
what several strategies do, ``vector`` is for learned policies, and ``perception`` comes before
any strategy.
"""
