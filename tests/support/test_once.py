"""Values that are found once for each object, and lost with it."""

import gc
import weakref

from exudyn_partition.support.once import once


class Thing:
    """Anything that can be referred to weakly."""


def test_a_value_is_found_once_an_object_and_its_further_arguments():
    asked = []

    @once
    def find(thing, *numbers):
        """Say what it finds."""
        asked.append((thing, *numbers))
        return [*numbers]

    one, other = Thing(), Thing()
    assert find(one) is find(one)
    assert find(one, 1) is find(one, 1)
    assert find(one) is not find(other)
    assert asked == [(one,), (one, 1), (other,)]
    assert find.__doc__ == "Say what it finds."


def test_neither_the_object_nor_its_value_is_kept_alive():
    class Value:
        pass

    find = once(lambda thing: Value())
    thing = Thing()
    gone = weakref.ref(thing), weakref.ref(find(thing))
    del thing
    gc.collect()
    assert [ref() for ref in gone] == [None, None]
