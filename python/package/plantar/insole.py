"""A session with an insole over the network or a serial port."""

from __future__ import annotations

import asyncio
import json
import time
import warnings
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from plantar import _core
from plantar.paths import Path, expanded


@dataclass(frozen=True)
class Event:
    """A message of an insole, or a change of its link."""

    kind: str
    """``live`` for a frame, ``step``, ``bout`` and ``alert`` for records, ``started`` and ``lost`` for the link."""
    values: dict[str, Any]
    """The values. docs/quantities.md describes their names: for a frame those of the columns, for a record the JSON keys. Frames,
    steps and load bouts have the values of the regions in ``regions``. ``lost`` has a text, ``reason``; ``started`` has none."""
    unix_s: float | None
    """Time of the frame, or of the start of the record, on this computer's clock, s since 1970, UTC, so several insoles share
    one time axis. ``None`` for a change of the link, and if the time is unknown."""


class Insole:
    """A connected insole: a context manager, and an iterable and an asynchronous iterable of events.

    A lost link is opened again. A loop over the insole waits without end if the insole does not return: ``events`` accepts a
    time-out. The insole deletes a record once the next event is requested. If the processing of a record
    raises an exception, the record therefore arrives again in the next session.
    """

    def __init__(self, core: _core.Insole, address: str) -> None:
        self._core = core
        self._address = address
        # Number of the delivered record that is acknowledged when the next event is requested.
        self._unacknowledged: int | None = None
        self._executor = ThreadPoolExecutor(1)
        # The call of `_receive` that runs in the thread of the executor. It is not discarded until its event is delivered, even
        # if the task that waits for it is cancelled.
        self._call: Future[Event | None] | None = None

    @classmethod
    def connect(cls, *, tcp: str | None = None, serial: str | None = None, baud: int = 460_800) -> Insole:
        """Opens a session with the insole at a network address, ``HOST:PORT``, or on a serial port such as ``/dev/ttyACM0``.

        ``baud`` is the bit rate of the serial port, bit/s. Raises a ``ConnectionError`` if no insole answers.
        """
        if (tcp is None) == (serial is None):
            raise ValueError("give either tcp or serial")
        if tcp is not None:
            return cls(_core.Insole.connect(tcp, None), tcp)
        assert serial is not None
        return cls(_core.Insole.connect(serial, baud), serial)

    def __repr__(self) -> str:
        try:
            hello = self.hello
        except RuntimeError:
            return f"<Insole at {self._address}: closed>"
        return (
            f"<Insole at {self._address}: {hello['side']} foot, {hello['cells']} cells at {hello['rate_hz']:g} Hz, "
            f"firmware {hello['firmware']}>"
        )

    @property
    def hello(self) -> dict[str, Any]:
        """Side, firmware, number of cells, frame rate and contact rule of the insole, among others."""
        hello: dict[str, Any] = json.loads(self._core.hello())
        return hello

    def push(self, params: Path) -> None:
        """Sends a parameter file to the insole, which uses it from its next frame on and stores it.

        An insole refuses parameters of another contact rule than its own; ``plantar params push`` sets the rule first. A
        ``UserWarning`` names parameters of the other foot, of another filter than that of step records, and those that are not
        personal.
        """
        for note in self._core.push(expanded(params)):
            warnings.warn(note, stacklevel=2)

    def next_event(self) -> Event | None:
        """The next event, or ``None`` if none arrived within about 50 ms, also while a lost link is opened again. A call can
        return ``None`` although the insole sends: not every message is an event."""
        call, self._call = self._call, None
        return self._receive() if call is None or call.cancelled() else call.result()

    def _receive(self) -> Event | None:
        if self._unacknowledged is not None:
            self._core.acknowledge(self._unacknowledged)
            self._unacknowledged = None
        event = self._core.next_event()
        if event is None:
            return None
        kind, values, unix_s = event[0], json.loads(event[1]), event[2]
        if kind in ("step", "bout", "alert"):
            self._unacknowledged = values["step" if kind == "step" else "number"]
        return Event(kind, values, unix_s)

    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """The events, as in a loop over the insole. The iteration ends if no event arrives for ``timeout_s``, s, for example
        because the insole was switched off; without a time-out, it waits for the insole. The insole deletes the last record
        before the iteration waits for the next event."""
        last_s = time.monotonic()
        while True:
            event = self.next_event()
            if event is not None:
                yield event
                # The time that the caller needs for an event does not count.
                last_s = time.monotonic()
            elif timeout_s is not None and time.monotonic() - last_s > timeout_s:
                return

    def __iter__(self) -> Iterator[Event]:
        return self.events()

    async def __aiter__(self) -> AsyncIterator[Event]:
        while True:
            if self._call is None or self._call.cancelled():
                try:
                    self._call = self._executor.submit(self._receive)
                except RuntimeError:
                    # After `close`, this call raises the error that names the remedy.
                    self._receive()
                    raise
            try:
                event = await asyncio.wrap_future(self._call)
            except asyncio.CancelledError:
                # The call in the thread continues, and the next iteration delivers its event.
                raise
            except BaseException:
                self._call = None
                raise
            self._call = None
            if event is not None:
                yield event

    def close(self) -> None:
        """Closes the link."""
        self._executor.shutdown()
        self._core.close()

    def __enter__(self) -> Insole:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
