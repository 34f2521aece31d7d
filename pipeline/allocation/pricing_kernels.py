"""The search for the best configuration of one stream, compiled.

A *state* is a multiset of periods that some covering pattern contains; state 0 is empty. ``add[q, p]`` is the
state of q with one more detector of period number p, -1 if no pattern contains it. A *unit* is one detector
that may be used once, or as often as states allow (repeat), at one of its options (load, profit, code).
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def _insert(loads, profits, nodes, size, load, profit, node):  # type: ignore[no-untyped-def]
    """Put a point into a front (ascending in load and profit); the new size, -1 if it is full, -2 if
    dominated.
    """
    low, high = 0, size
    while low < high:  # at: the first point with a greater load
        middle = (low + high) >> 1
        if loads[middle] <= load:
            low = middle + 1
        else:
            high = middle
    at = low
    if at > 0 and profits[at - 1] >= profit:
        return -2
    if at > 0 and loads[at - 1] == load:
        at -= 1
    end = at
    while end < size and profits[end] <= profit:
        end += 1
    removed = end - at
    if removed == 0:
        if size == loads.shape[0]:
            return -1
        for i in range(size, at, -1):
            loads[i], profits[i], nodes[i] = loads[i - 1], profits[i - 1], nodes[i - 1]
    else:
        for i in range(end, size):
            j = i - removed + 1
            loads[j], profits[j], nodes[j] = loads[i], profits[i], nodes[i]
    loads[at], profits[at], nodes[at] = load, profit, node
    return size + 1 - removed


@numba.njit(cache=True)
def _still_to_come(add, unit_period, first_option, option_load, capacity):  # type: ignore[no-untyped-def]
    """Per state, the most that detectors added later can load; units must ascend by period."""
    states, periods = add.shape
    most = np.zeros(periods, dtype=np.int64)
    for u in range(unit_period.shape[0]):
        for option in range(first_option[u], first_option[u + 1]):
            if option_load[option] <= capacity and option_load[option] > most[unit_period[u]]:
                most[unit_period[u]] = option_load[option]
    last = np.zeros(states, dtype=np.int64)
    for q in range(states):
        for p in range(last[q], periods):
            if add[q, p] >= 0:
                last[add[q, p]] = p
    more = np.zeros(states, dtype=np.int64)
    for q in range(states - 1, -1, -1):
        for p in range(last[q], periods):
            if add[q, p] >= 0 and most[p] + more[add[q, p]] > more[q]:
                more[q] = most[p] + more[add[q, p]]
    return more


@numba.njit(cache=True)
def site_fronts(  # type: ignore[no-untyped-def]
    add,
    capacity,
    unit_period,
    unit_repeat,
    first_option,
    option_load,
    option_profit,
    loads,
    profits,
    nodes,
    parents,
    codes,
):
    """Every state's front of (load, profit) at one site, over all choices of units.

    Unit u has the options first_option[u] .. first_option[u + 1] - 1; units ascend by period. Loads that can
    never grow beyond the capacity are all counted as the greatest such: only the profit is left to tell those
    points apart. loads, profits, nodes: (states, F), the fronts; parents, codes: (N,), the nodes, of which
    number 0 is the empty choice; codes holds numbers of options. Returns the sizes of the fronts, and the
    number of nodes: -1 if F or N was too small.
    """
    states = add.shape[0]
    more = _still_to_come(add, unit_period, first_option, option_load, capacity)
    sizes = np.zeros(states, dtype=np.int64)
    sizes[0], used = 1, 1
    loads[0, 0], profits[0, 0], nodes[0, 0], parents[0], codes[0] = max(0, capacity - more[0]), 0.0, 0, -1, -1
    for u in range(unit_period.shape[0]):
        for step in range(states):
            # a repeated unit finds its own results on the way up, a single one must not
            q = step if unit_repeat[u] else states - 1 - step
            to = add[q, unit_period[u]]
            if to < 0 or sizes[q] == 0:
                continue
            for point in range(sizes[q]):
                for option in range(first_option[u], first_option[u + 1]):
                    load = loads[q, point] + option_load[option]
                    if load > capacity:
                        break
                    if used == parents.shape[0]:
                        return sizes, -1
                    load = max(load, capacity - more[to])
                    profit = profits[q, point] + option_profit[option]
                    size = _insert(loads[to], profits[to], nodes[to], sizes[to], load, profit, used)
                    if size == -1:
                        return sizes, -1
                    if size > 0:
                        sizes[to] = size
                        parents[used], codes[used] = nodes[q, point], option
                        used += 1
    return sizes, used


@numba.njit(cache=True)
def combine_sites(first_split, split_here, split_rest, best_here, penalty, total, taken):  # type: ignore[no-untyped-def]
    """Share each state among this site and those before it; (max, +) convolution over sub-multisets.

    State q splits into split_here[i] and split_rest[i], i = first_split[q] .. first_split[q + 1] - 1.
    best_here: (states,) profit at this site. total: (states,) over the sites before, replaced. taken:
    (states,) what this site gets.
    """
    states = total.shape[0]
    result = np.full(states, -np.inf)
    for q in range(states):
        for i in range(first_split[q], first_split[q + 1]):
            here, rest = split_here[i], split_rest[i]
            value = total[rest] + best_here[here] - (penalty if here != 0 else 0.0)
            if value > result[q]:
                result[q] = value
                taken[q] = here
    total[:] = result
