"""Items of a model: which one is meant."""

from exudyn_partition.support.items import Item


def test_an_item_equals_itself_alone():
    """Bodies of two models may have the same indices; a dict would take one for the other."""
    one, other = Item(nModal=0, oGenericODE2=0), Item(nModal=0, oGenericODE2=0)
    assert one == one
    assert one != other
    assert other not in (one,)
    assert (one, other).index(other) == 1
    assert len({one, other}) == 2
    assert dict(one) == dict(other)
