"""Ruin and recreate under simulated annealing, for the normal form.

Ruin: strings of neighbouring clusters (Christiaens, Vanden Berghe 2020), one segment, the nearest
clusters, or random ones. Recreate: cheapest insertion over all positions and nodes, with blinks.
Then one anchored pass of cluster optimisation, and Metropolis acceptance.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit
from sequencing.gtsp.arrays import below, uniform
from sequencing.gtsp.cluster_optimisation import (
    closed_cost,
    optimise_anchored,
    optimise_clusters,
    optimise_windows,
)


@njit
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


@njit
def insert_cheapest(tables, blink, state, order, node, edge, size, g):  # type: ignore[no-untyped-def]
    """Insert cluster g into order/node[:size] at its cheapest place; returns the added cost.

    The tables' `into` and `outof` prune the places. edge[k] is the cost from node[k−1] to node[k],
    edge[0] closes the tour. A place is skipped with probability `blink`.
    """
    cost, turned, ptr, before = tables.cost, tables.turned, tables.ptr, tables.before
    low, high = 1, size
    if tables.ordered:
        low = 1 if tables.pinned else 0
        for k in range(size):
            if before[order[k], g]:
                low = k + 1
        for k in range(size - 1, -1, -1):
            if before[g, order[k]]:
                high = k
    best = np.inf
    at, with_node = -1, -1
    begin, end = ptr[g], ptr[g + 1]
    reach = tables.into[g]
    leave = tables.outof[g]
    for k in range(low, high + 1):
        a = node[k - 1] if k > 0 else node[size - 1]
        b = node[k] if k < size else node[0]
        base = edge[k] if k < size else edge[0]
        if reach[a] + leave[b] - base >= best:
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
        edge[k] = edge[k - 1]
    order[at] = g
    node[at] = with_node
    a = node[at - 1] if at > 0 else node[size]
    edge[at] = cost[a, with_node]
    after = at + 1 if at < size else 0
    edge[after] = cost[with_node, node[after]]
    return best


@njit
def spread(order, touched, active):  # type: ignore[no-untyped-def]
    """active[k]: position k is within two places of a touched cluster (cyclic)."""
    m = len(order)
    active[:] = False
    for k in range(m):
        if touched[order[k]]:
            for d in range(-2, 3):
                active[(k + d + m) % m] = True


@njit
def turn(array, shift, work):  # type: ignore[no-untyped-def]
    """Turn array (M,) so that position `shift` comes first."""
    m = len(array)
    for k in range(m):
        work[k] = array[k]
    for k in range(m):
        array[k] = work[(k + shift) % m]


@njit
def anneal(  # type: ignore[no-untyped-def]
    tables, current, best, span, heat, largest, blink, goal, state
):
    """Iterations begin … end−1 of total = `span`; temperature falls geometrically from hot to cold
    = `heat`.

    current and best (M,) nodes are read and overwritten; stops early at cost ≤ goal.
    Returns (cost of best, iterations done).
    """
    cost, ptr, cluster, near = tables.cost, tables.ptr, tables.cluster, tables.near
    ordered, pinned = tables.ordered, tables.pinned
    begin, end, total = span
    hot, cold = heat
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
    touched = np.zeros(m, dtype=np.bool_)
    active = np.zeros(m, dtype=np.bool_)
    parent_edge = np.empty(m)
    current_edge = np.empty(m)
    for k in range(m):
        place[here[k]] = k
        current_edge[k] = cost[current[k - 1 if k > 0 else m - 1], current[k]]
    ratio = cold / hot
    gain = 5.0 * hot
    edge = np.empty(m)
    temperature = hot
    for i in range(begin, end):
        if best_cost <= goal:
            return best_cost, i - begin
        if i % 16 == 0 or i == begin:
            temperature = hot * ratio ** (i / total)
        count = choose(state, here, place, near, pinned, largest, gone)
        size = 0
        taken = 0
        new_cost = 0.0
        for k in range(m):
            if gone[here[k]]:
                removed[taken] = here[k]
                taken += 1
            else:
                order[size] = here[k]
                node[size] = current[k]
                touched[here[k]] = False
                if size > 0:
                    if gone[here[k - 1]]:
                        edge[size] = cost[node[size - 1], node[size]]
                        touched[here[k]] = True
                    else:
                        edge[size] = current_edge[k]
                    new_cost += edge[size]
                size += 1
        if gone[here[0]] or gone[here[m - 1]]:
            edge[0] = cost[node[size - 1], node[0]] if size > 1 else 0.0
            touched[order[0]] = True
        else:
            edge[0] = current_edge[0]
        new_cost += edge[0]
        for k in range(count - 1, 0, -1):
            j = below(state, k + 1)
            removed[k], removed[j] = removed[j], removed[k]
        shy = 0.5 if uniform(state) < 0.03 else blink
        for k in range(count):
            new_cost += insert_cheapest(tables, shy, state, order, node, edge, size, removed[k])
            touched[removed[k]] = True
            size += 1
        limit = current_cost - temperature * np.log(uniform(state) + 1e-300)
        if new_cost > limit + gain:
            continue  # cluster optimisation rarely gains that much
        inserted = new_cost
        spread(order, touched, active)
        if active[0] and not pinned and not ordered:  # anchor where nothing changed
            shift = below(state, m)
            for _ in range(m):
                if not active[shift]:
                    break
                shift = (shift + 1) % m
            turn(order, shift, removed)
            turn(node, shift, removed)
            turn(edge, shift, parent_edge)
            turn(active, shift, gone)
        new_cost = optimise_windows(cost, ptr, order, active, edge, m, node, dist, parent)
        if new_cost < best_cost - 1e-12 * abs(best_cost):
            new_cost = optimise_anchored(cost, ptr, order, m, node, dist, parent)
        if not pinned and (m <= 6 or new_cost < best_cost - 1e-12 * abs(best_cost)):
            new_cost = optimise_clusters(cost, ptr, order, m, node, dist, parent)
        gain = max(inserted - new_cost, 0.99 * gain)
        if new_cost < limit:
            current_cost = new_cost
            here[:] = order
            current[:] = node
            for k in range(m):
                place[here[k]] = k
                current_edge[k] = cost[current[k - 1 if k > 0 else m - 1], current[k]]
            if new_cost < best_cost - 1e-12 * abs(best_cost):
                best_cost = new_cost
                best[:] = node
    return best_cost, end - begin
