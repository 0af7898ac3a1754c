"""Ruin and recreate under simulated annealing, for the normal form.

Ruin: strings of neighbouring clusters (Christiaens, Vanden Berghe 2020), one segment, the nearest
clusters, or random ones. Recreate: cheapest insertion over all positions and nodes, with blinks.
Then one anchored pass of cluster optimisation, and Metropolis acceptance.
"""

from __future__ import annotations

import numpy as np

from sequencing.gtsp.cluster_optimisation import closed_cost, optimise_anchored, optimise_clusters
from sequencing.gtsp.jit import jit
from sequencing.gtsp.rng import below, uniform


@jit
def choose(state, order, place, near, pinned, largest, gone):  # type: ignore[no-untyped-def]
    """Mark clusters to remove in `gone` (M,) and return how many.

    order (M,) clusters by position, place (M,) its inverse, near (M, K) neighbours by distance.
    """
    m = len(order)
    gone[:] = False
    free = m - 1  # the depot or, without one, any one cluster stays
    first = 1 if pinned else 0
    wanted = 1 + below(state, min(largest, free))
    kind = uniform(state)
    seed = order[first + below(state, m - first)]
    count = 0
    if kind < 0.4:  # strings around a seed
        length = 1 + below(state, max(1, min(10, wanted)))
        reach = 0
        while count < wanted and reach < near.shape[1] + 1:
            g = seed if reach == 0 else near[seed, reach - 1]
            reach += 1
            if gone[g] or (pinned and g == 0):
                continue
            begin = place[g] - below(state, length)
            for k in range(begin, begin + length):
                h = order[(k + m) % m]
                if count < wanted and not gone[h] and not (pinned and h == 0):
                    gone[h] = True
                    count += 1
    elif kind < 0.6:  # one segment
        begin = place[seed]
        for k in range(begin, begin + wanted):
            h = order[k % m]
            if not (pinned and h == 0):
                gone[h] = True
                count += 1
    elif kind < 0.8:  # nearest clusters, some skipped
        gone[seed] = True
        count = 1
        for k in range(near.shape[1]):
            h = near[seed, k]
            if count >= wanted:
                break
            if not (pinned and h == 0) and uniform(state) < 0.7:
                gone[h] = True
                count += 1
    else:
        for _ in range(wanted):
            h = order[first + below(state, m - first)]
            if not gone[h]:
                gone[h] = True
                count += 1
    return count


@jit
def insert_cheapest(  # type: ignore[no-untyped-def]
    cost, turned, into, outof, ptr, before, ordered, pinned, blink, state, order, node, size, g
):
    """Insert cluster g into order/node[:size] at its cheapest place; returns the added cost.

    turned = costᵀ; into (N, M) and outof (N, M): least cost from a node into and out of a
    cluster, which prunes the places. A place is skipped with probability `blink`.
    """
    low, high = 1, size
    if ordered:
        low = 1 if pinned else 0
        for k in range(size):
            if before[order[k], g]:
                low = k + 1
        for k in range(size - 1, -1, -1):
            if before[g, order[k]]:
                high = k
    best = np.inf
    at, with_node = -1, -1
    begin, end = ptr[g], ptr[g + 1]
    for k in range(low, high + 1):
        a = node[k - 1] if k > 0 else node[size - 1]
        b = node[k] if k < size else node[0]
        base = cost[a, b] if size > 1 else 0.0
        if into[a, g] + outof[b, g] - base >= best:
            continue
        if blink > 0.0 and at >= 0 and uniform(state) < blink:
            continue
        from_a = cost[a]
        to_b = turned[b]
        for v in range(begin, end):
            delta = from_a[v] + to_b[v] - base
            if delta < best:
                best = delta
                at, with_node = k, v
    if at < 0:  # nothing is below +inf only if there is no place: precedences kept order feasible
        at, with_node = low, begin
        best = 0.0
    for k in range(size, at, -1):
        order[k] = order[k - 1]
        node[k] = node[k - 1]
    order[at] = g
    node[at] = with_node
    return best


@jit
def anneal(  # type: ignore[no-untyped-def]
    cost, turned, into, outof, ptr, cluster, before, ordered, pinned, near,
    current, best, begin, end, total, hot, cold, largest, blink, goal, state,
):  # fmt: skip
    """Iterations begin … end−1 of `total`; temperature falls geometrically from hot to cold.

    current and best (M,) nodes are read and overwritten; stops early at cost ≤ goal.
    Returns (cost of best, iterations done).
    """
    m = len(ptr) - 1
    order = np.empty(m, dtype=np.int64)
    node = np.empty(m, dtype=np.int64)
    place = np.empty(m, dtype=np.int64)
    here = cluster[current]
    gone = np.zeros(m, dtype=np.bool_)
    removed = np.empty(m, dtype=np.int64)
    dist = np.empty(len(cost))
    parent = np.empty(len(cost), dtype=np.int64)
    current_cost = closed_cost(cost, current, m)
    best_cost = closed_cost(cost, best, m)
    for k in range(m):
        place[here[k]] = k
    ratio = cold / hot
    temperature = hot
    for i in range(begin, end):
        if best_cost <= goal:
            return best_cost, i - begin
        if i % 16 == 0 or i == begin:
            temperature = hot * ratio ** (i / total)
        count = choose(state, here, place, near, pinned, largest, gone)
        size = 0
        taken = 0
        for k in range(m):
            if gone[here[k]]:
                removed[taken] = here[k]
                taken += 1
            else:
                order[size] = here[k]
                node[size] = current[k]
                size += 1
        for k in range(count - 1, 0, -1):
            j = below(state, k + 1)
            removed[k], removed[j] = removed[j], removed[k]
        shy = 0.5 if uniform(state) < 0.03 else blink
        for k in range(count):
            insert_cheapest(
                cost, turned, into, outof, ptr, before, ordered, pinned, shy, state,
                order, node, size, removed[k],
            )  # fmt: skip
            size += 1
        if not pinned and not ordered:  # another anchor every time
            shift = below(state, m)
            for k in range(m):
                removed[k] = order[(k + shift) % m]
                parent[k] = node[(k + shift) % m]
            order[:] = removed
            node[:] = parent[:m]
        new_cost = optimise_anchored(cost, ptr, order, m, node, dist, parent)
        if not pinned and (m <= 6 or new_cost < best_cost - 1e-12 * abs(best_cost)):
            new_cost = optimise_clusters(cost, ptr, order, m, node, dist, parent)
        if new_cost < current_cost - temperature * np.log(uniform(state) + 1e-300):
            current_cost = new_cost
            here[:] = order
            current[:] = node
            for k in range(m):
                place[here[k]] = k
            if new_cost < best_cost - 1e-12 * abs(best_cost):
                best_cost = new_cost
                best[:] = node
    return best_cost, end - begin
