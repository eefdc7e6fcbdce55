"""The crosswalk in traffic: streams of vehicles and pedestrians over hours, both arms of a pair."""
