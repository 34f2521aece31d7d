"""All configurations of one covering pattern that are worth a given least, compiled."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def enumerate_pattern(  # type: ignore[no-untyped-def]
    slots,
    first_item,
    item_kind,
    item_site,
    item_load,
    item_profit,
    item_kept,
    kept_worth,
    copies,
    capacity,
    penalty,
    least,
    found,
):
    """Write every choice of items into found (N, len(slots)); their number, -1 if there are more than N.

    slots: period number per detector, ascending. Items of period p are first_item[p] .. first_item[p + 1] -
    1, by ``item_profit`` plus what going on is worth, descending; slots of one period take items in ascending
    order. An item that can go on (item_kept) is worth kept_worth more so many times. copies: by kind.
    """
    n = slots.shape[0]
    rest = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        first, last = first_item[slots[i]], first_item[slots[i] + 1]
        if first == last:
            return 0
        rest[i] = rest[i + 1] + item_profit[first] + (kept_worth if item_kept[first] > 0 else 0.0)
    chosen = np.full(n, -1, dtype=np.int64)
    worth = np.zeros(n + 1)
    count, i = 0, 0
    chosen[0] = first_item[slots[0]] - 1
    while i >= 0:
        chosen[i] += 1
        item = chosen[i]
        hopeful = False
        if item < first_item[slots[i] + 1]:
            optimistic = item_profit[item] + (kept_worth if item_kept[item] > 0 else 0.0)
            hopeful = worth[i] + optimistic + rest[i + 1] >= least
        if not hopeful:
            i -= 1
            continue
        kind, site = item_kind[item], item_site[item]
        of_kind, of_item, load, new_site = 1, 0, item_load[item], True
        for j in range(i):
            other = chosen[j]
            of_kind += item_kind[other] == kind
            of_item += other == item
            if item_site[other] == site:
                load += item_load[other]
                new_site = False
        if of_kind > copies[kind] or load > capacity[site]:
            continue
        gain = item_profit[item] - (penalty if new_site else 0.0)
        if of_item < item_kept[item]:
            gain += kept_worth
        worth[i + 1] = worth[i] + gain
        if worth[i + 1] + rest[i + 1] < least:
            continue
        if i == n - 1:
            if count == found.shape[0]:
                return -1
            found[count] = chosen
            count += 1
            continue
        i += 1
        chosen[i] = item - 1 if slots[i] == slots[i - 1] else first_item[slots[i]] - 1
    return count
