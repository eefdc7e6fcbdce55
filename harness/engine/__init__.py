"""Commands in; moved vehicles and held pedestrians out, in SUMO or plain Python."""
