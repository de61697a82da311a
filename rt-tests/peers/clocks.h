// Times of single questions, as rt-tests/src/clocks.rs takes them.

#pragma once

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <vector>

// Both clocks of one moment: wall time has the time of other processes in it; processor time takes
// long to be read, and now and then longer than it took when that was measured.
struct Reading {
    int64_t wall, cpu;
};

static int64_t clock_ns(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

static Reading start() {
    const int64_t cpu = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    return {clock_ns(CLOCK_MONOTONIC), cpu};
}

static Reading taken_since(const Reading &from) {
    const int64_t wall = clock_ns(CLOCK_MONOTONIC) - from.wall;
    return {wall, clock_ns(CLOCK_THREAD_CPUTIME_ID) - from.cpu};
}

static Reading cost_of_clocks() {
    std::vector<int64_t> wall, cpu;
    for (int k = 0; k < 1001; k++) {
        const Reading taken = taken_since(start());
        wall.push_back(taken.wall);
        cpu.push_back(taken.cpu);
    }
    std::sort(wall.begin(), wall.end());
    std::sort(cpu.begin(), cpu.end());
    return {wall[500], cpu[500]};
}

// Wall time counts, unless processor time says that others ran meanwhile: it is read around wall
// time, so only then is less of it.
static int64_t ns_of(const Reading &taken, const Reading &cost) {
    const int64_t wall = std::max<int64_t>(0, taken.wall - cost.wall);
    if (taken.cpu >= taken.wall) return wall;
    return std::min(wall, std::max<int64_t>(0, taken.cpu - cost.cpu));
}
