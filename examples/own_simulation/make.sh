#!/bin/sh
# Makes the network and the demand of this example: a main street for ten minutes.
# J7 is a crosswalk between junctions, J8 has a traffic light, J9 has none.
set -e
cd "$(dirname "$0")"
SUMO_HOME=${SUMO_HOME:-$(python -c "import sumo; print(sumo.SUMO_HOME)")}

netconvert --node-files town.nod.xml --edge-files town.edg.xml --connection-files town.con.xml \
    --crossings.guess --no-turnarounds --output-file town.net.xml

trips() {
    file=$1
    shift
    python "$SUMO_HOME/tools/randomTrips.py" --net-file town.net.xml --end 600 "$@" \
        --output-trip-file trips.xml --route-file "$file"
    rm -f trips.xml "${file%.rou.xml}.rou.alt.xml"
}
trips cars.rou.xml --seed 1 --insertion-rate 800 --vehicle-class passenger --prefix car \
    --fringe-factor 20 --speed-exponent 4
trips trucks.rou.xml --seed 2 --insertion-rate 80 --vehicle-class truck --prefix truck \
    --fringe-factor 20 --speed-exponent 4
trips people.rou.xml --seed 3 --insertion-rate 600 --pedestrians --prefix p \
    --min-distance 100 --max-distance 400

# The headers have dates and paths.
sed -i -e "/<!--/,/-->/d" -e "/^$/d" town.net.xml cars.rou.xml trucks.rou.xml people.rou.xml
