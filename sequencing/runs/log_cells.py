"""Kernel that reads the cells of a log from its bytes: a million rows in seconds."""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit

#: What a row can be refused for.
ROW_CELLS, ROW_NUMBER = 1, 2
_POWERS = 10.0 ** np.arange(-300, 301)
_QUOTE, _BLANK, _TAB, _COMMA, _POINT = (ord(c) for c in '" \t,.')


@njit(inner=True)
def number_at(data, start, end):  # type: ignore[no-untyped-def]
    """The decimal number in data[start:end], whether it is one, and its decimal mark (0: none)."""
    k, mark, digits, shift = start, 0, 0, 0
    sign, value = 1.0, 0.0
    if k < end and (data[k] == 43 or data[k] == 45):
        sign = -1.0 if data[k] == 45 else 1.0
        k += 1
    while k < end:
        c = data[k]
        if 48 <= c <= 57:
            if value < 1e17:  # further digits are below the last place of a float
                value = 10.0 * value + (c - 48)
                shift -= mark != 0
            else:
                shift += mark == 0
            digits += 1
        elif c in (_POINT, _COMMA) and mark == 0:
            mark = c
        else:
            break
        k += 1
    if digits > 0 and k < end and (data[k] == 69 or data[k] == 101):
        k += 1
        turn = 1
        if k < end and (data[k] == 43 or data[k] == 45):
            turn = -1 if data[k] == 45 else 1
            k += 1
        power, first = 0, k
        while k < end and 48 <= data[k] <= 57:
            if power < 1000:
                power = 10 * power + (data[k] - 48)
            k += 1
        if k == first:
            return 0.0, False, mark
        shift += turn * power
    good = digits > 0 and k == end and -300 <= shift <= 300
    if not good:
        return 0.0, False, mark
    if -22 <= shift < 0:  # dividing by an exact power rounds once
        value = value / _POWERS[300 - shift]
    else:
        value = value * _POWERS[300 + shift]
    return sign * value, True, mark


@njit
def lines_with_cells(data, starts, ends):  # type: ignore[no-untyped-def]
    """Whether line k, data[starts[k]:ends[k]], is neither blank nor begins with #."""
    kept = np.zeros(len(starts), dtype=np.bool_)
    for row in range(len(starts)):
        for k in range(starts[row], ends[row]):
            if data[k] != _BLANK and data[k] != _TAB:
                kept[row] = data[starts[row]] != 35
                break
    return kept


@njit
def read_cells(  # type: ignore[no-untyped-def]
    data, starts, ends, separator, slot, out, empty, marks
):
    """Fill out (rows, used) from lines data[starts:ends]; the first fault (kind, row, column).

    `slot` (columns,) has the column of `out`, or −1 for what is not used. An empty cell is NaN and
    counted in `empty` (used,), with its first row in the second row of that array. `marks` (2,)
    takes the first row with a decimal comma and with a point.
    """
    columns = len(slot)
    for row in range(len(starts)):
        k, end, column = starts[row], ends[row], 0
        while True:
            while k < end and (data[k] == _BLANK or (data[k] == _TAB and separator != _TAB)):
                k += 1
            begin, quoted = k, False
            while k < end:
                c = data[k]
                if c == _QUOTE:
                    quoted = not quoted
                elif not quoted and (c == separator or (separator == _BLANK and c == _TAB)):
                    break
                k += 1
            last = k
            while last > begin and (data[last - 1] == _BLANK or data[last - 1] == _TAB):
                last -= 1
            if last - begin >= 2 and data[begin] == _QUOTE and data[last - 1] == _QUOTE:
                begin, last = begin + 1, last - 1
            if separator == _BLANK and last == begin and k >= end:
                break  # blanks at the end of a line
            if column >= columns:
                return ROW_CELLS, row, column
            if slot[column] >= 0:
                used = slot[column]
                if last == begin:
                    out[row, used] = np.nan
                    if empty[0, used] == 0:
                        empty[1, used] = row
                    empty[0, used] += 1
                else:
                    value, good, mark = number_at(data, begin, last)
                    if not good:
                        return ROW_NUMBER, row, column
                    out[row, used] = value
                    if mark != 0:
                        which = 0 if mark == _COMMA else 1
                        if marks[which] < 0:
                            marks[which] = row
            column += 1
            if k >= end:
                break
            k += 1
        if column != columns:
            return ROW_CELLS, row, column
    return 0, 0, 0
