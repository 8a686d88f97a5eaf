"""How long a new job waits for those before it: against workers that are played step by step."""

from __future__ import annotations

import random

from service.jobs.estimates import _Ahead
from tests.cases import each_case


def played(running: list[int], queued: list[int], workers: int) -> int:
    """Steps until a worker is free for a new job, each worker doing one step at a time."""
    hands, waiting, steps = [*running, *[0] * (workers - len(running))], list(queued), 0
    while True:
        for hand, left in enumerate(hands):
            if left == 0 and waiting:
                hands[hand] = waiting.pop(0)
        if not waiting and 0 in hands:
            return steps
        hands = [max(0, left - 1) for left in hands]
        steps += 1


@each_case("seed", range(20))
def test_workers_that_are_played_agree(seed: int) -> None:
    chance = random.Random(seed)
    workers = chance.randint(1, 4)
    running = [chance.randint(1, 30) for _ in range(chance.randint(0, workers))]
    queued = [chance.randint(1, 30) for _ in range(chance.randint(0, 8))]
    assert _Ahead(running, queued, 0).seconds_until_free(workers) == played(running, queued, workers)


def test_an_idle_worker_takes_a_job_at_once_and_others_count_like_the_mean() -> None:
    assert _Ahead([500], [], 0).seconds_until_free(2) == 0
    assert _Ahead([], [10, 30], 6).seconds_until_free(1) == 10 + 30 + 6 * 20
    assert _Ahead([], [20, 20], 6).seconds_until_free(2) == 20 + 6 * 20 / 2
    assert _Ahead([3, 9, 6], [], 0).seconds_until_free(1) == 9
