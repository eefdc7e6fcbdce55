"""Takes a stored run and repeats its episodes, with SUMO's own outputs or in sumo-gui."""
