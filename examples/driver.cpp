// A strategy in a process of its own, as examples/driver.py: arms.av = "exec:./driver --comfortable 2.5".
//   g++ -std=c++17 -O2 -o driver examples/driver.cpp
// One JSON line for each observation on standard input, one number (m/s²) back.
#include <algorithm>
#include <iomanip>
#include <iostream>
#include <string>

// The number behind "key": from a place of the line on; keys are unique within their object.
static double number(const std::string& line, const std::string& key, std::size_t from) {
    const std::string quoted = "\"" + key + "\": ";
    return std::stod(line.substr(line.find(quoted, from) + quoted.size(), 32));
}

static bool in_the_way(const std::string& line) {
    const double passed_m = -1.85;  // so far past the lane's centre they have left the ego's path
    const std::size_t end = line.find("\"vehicle\"");
    std::size_t at = line.find("\"index\"");
    for (; at < end; at = line.find("\"index\"", at + 1)) {
        const std::size_t flag = line.find("\"on_crossing\": ", at) + 15;
        if (line.compare(flag, 4, "true") == 0 && number(line, "lateral_m", at) > passed_m) return true;
    }
    return false;
}

int main(int count, char** words) {
    const double comfortable = count > 2 ? std::stod(words[2]) : 2.5;
    std::cout << std::setprecision(17);
    for (std::string line; std::getline(std::cin, line);) {
        const std::size_t ego = line.find("\"ego\""), vehicle = line.find("\"vehicle\"");
        const double range = number(line, "range_m", ego), speed = number(line, "speed_mps", ego);
        const double room = range - number(line, "stop_line_m", vehicle);
        const bool somebody = in_the_way(line);
        const double v0 = number(line, "initial_speed_mps", vehicle), step = number(line, "step_s", 0);
        // The later the vehicle obeys, the longer it takes to get to v0, or it would overshoot.
        const double late = number(line, "dead_time_s", vehicle) + number(line, "lag_s", vehicle);
        const double back = (v0 - speed) / (step + 3 * late);
        double wanted = std::min(number(line, "resume_acceleration_mps2", vehicle), back);
        if (somebody && range > 0) wanted = room > 0 ? 0.0 : -number(line, "max_deceleration_mps2", vehicle);
        if (somebody && room > 0 && speed * speed / (2 * room) > comfortable) wanted = -speed * speed / (2 * room);
        std::cout << wanted << std::endl;
    }
}
