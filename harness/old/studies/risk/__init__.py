"""Takes a scenario and an event and returns the event's probability, by importance sampling."""
