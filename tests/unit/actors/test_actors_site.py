import pytest

from actors.site import all_sites, placement, require_sites
from pipeline.errors import InputError


def test_a_node_that_plays_a_site_takes_the_actors_placed_there() -> None:
    ((name, needed),) = placement("ground").items()
    assert needed <= all_sites(["ground", "drone-1"])[name]


def test_a_site_that_no_node_plays_is_named_with_the_command_that_starts_one() -> None:
    with pytest.raises(InputError, match=r"site:drone-1.*ray start .*--resources"):
        require_sites(["ground", "drone-1"], {"site:ground": 1.0, "CPU": 2.0}, "10.0.0.1:6379")
