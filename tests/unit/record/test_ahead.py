"""How long a new job waits for those before it: against workers that are played step by step."""

from __future__ import annotations

import random

from service.jobs.estimates import _Ahead
from tests.cases import each_case

Work = tuple[str, int]
NEW = ("a", 10**6)


def played(running: list[Work], queued: list[Work], workers: int, most: int) -> int:
    """Steps until a worker takes a new job of owner `a`, each worker doing one step at a time."""
    hands: list[Work | None] = [*running, *[None] * (workers - len(running))]
    waiting, steps = [*queued, NEW], 0
    while True:
        for hand, work in enumerate(hands):
            busy = [each[0] for each in hands if each is not None]
            free = next((each for each in waiting if not most or busy.count(each[0]) < most), None)
            if work is None and free is not None:
                hands[hand] = free
                waiting.remove(free)
        if NEW in hands:
            return steps
        hands = [None if work is None or work[1] <= 1 else (work[0], work[1] - 1) for work in hands]
        steps += 1


@each_case("seed", range(40))
def test_workers_that_are_played_agree(seed: int) -> None:
    chance = random.Random(seed)
    workers, most = chance.randint(1, 4), seed % 3
    running: list[Work] = [(chance.choice("abc"), chance.randint(1, 30)) for _ in range(chance.randint(0, workers))]
    if most:  # as no more of them run
        running = [work for at, work in enumerate(running) if [each[0] for each in running[:at]].count(work[0]) < most]
    queued: list[Work] = [(chance.choice("abc"), chance.randint(1, 30)) for _ in range(chance.randint(0, 8))]
    found = _Ahead(list(running), list(queued), 0).seconds_until_free(workers, "a", most)
    assert found == played(running, queued, workers, most)


def own(*seconds: float) -> list[tuple[str, float]]:
    return [("", each) for each in seconds]


def test_an_idle_worker_takes_a_job_at_once_and_others_count_like_the_mean() -> None:
    assert _Ahead(own(500), [], 0).seconds_until_free(2) == 0
    assert _Ahead([], own(10, 30), 6).seconds_until_free(1) == 10 + 30 + 6 * 20
    assert _Ahead([], own(20, 20), 6).seconds_until_free(2) == 20 + 6 * 20 / 2
    assert _Ahead(own(3, 9, 6), [], 0).seconds_until_free(1) == 9


def test_an_owner_that_runs_as_many_as_it_may_waits_for_one_of_its_own() -> None:
    assert _Ahead(own(500), [], 0).seconds_until_free(9, "", 1) == 500
    assert _Ahead(own(500), [], 0).seconds_until_free(9, "another", 1) == 0
