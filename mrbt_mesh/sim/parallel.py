"""Many independent pieces of work in several processes."""

from __future__ import annotations

import gc
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice
from typing import TypeVar

CHUNK = 4
_Item = TypeVar("_Item")
_Answer = TypeVar("_Answer")


def spread(
    work: Callable[[_Item], _Answer], items: Iterable[_Item], jobs: int, chunk: int = CHUNK
) -> Iterator[_Answer]:
    """The answers for all items, in the order in which they are ready.

    Several `jobs` work in as many new processes, which get `chunk` items at a time, leave Ctrl-C to
    this process and end when the iterator is closed or exhausted; `work` must be picklable then.
    """
    if jobs == 1:
        yield from map(work, items)
        return
    context = multiprocessing.get_context("spawn")
    rest = iter(items)
    chunks = iter(lambda: list(islice(rest, chunk)), [])
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
    try:
        running: set[Future[list[_Answer]]] = set()
        while True:
            # A short queue, so that an interrupt does not wait for long.
            while len(running) < 2 * jobs and (part := next(chunks, None)):
                running.add(pool.submit(_chunk, work, part))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield from future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _chunk(work: Callable[[_Item], _Answer], items: Sequence[_Item]) -> list[_Answer]:
    answers = []
    for item in items:
        answers.append(work(item))
        gc.collect()
    return answers


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A run makes few cycles but the one of all that it is made of: they are collected at its end.
    gc.freeze()
    gc.disable()
