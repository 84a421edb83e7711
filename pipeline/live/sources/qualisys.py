"""Markers, plates and analog channels of Qualisys Track Manager, by the vendor's client qtm-rt.

The protocol is that of https://docs.qualisys.com/qtm-rt-protocol/.
"""

import asyncio
import threading
from collections import deque
from typing import Any, Final

from pipeline.io.stated import Stated
from pipeline.live.network import import_extra
from pipeline.live.sources.changes import came_back
from pipeline.live.sources.qualisys_frames import Frames, read_parameters
from pipeline.live.stream import Samples, StatedPlate, StreamDescription

PORT: Final = 22223
"""Of the protocol with the low byte first."""
RETRY_S: Final = 1.0
"""Between attempts to reach a computer that has gone away."""
MAX_WAITING: Final = 10_000
"""Pieces kept for a receiver that is busy; then the oldest are lost."""


class QualisysSource:
    """Receives what Qualisys Track Manager sends in real time.

    Parameters
    ----------
    host, port
        Where it runs; its port for the low byte first, 22223 by default.
    stated
        What a person states: the axes (necessary), labels to rename, the prefix of the subject.
    timeout_s
        How long an answer is waited for.

    Raises
    ------
    ValueError
        The extra is missing, or the program's parameters lack markers or something that is needed.
    ConnectionError
        Nothing answers there.

    Notes
    -----
    Time is that of the program's own clock: of markers the time stamp of the frame, of plates and
    analog channels the number of the sample over its rate, from the same start. Markers are in lab
    axes [m]. Forces that the program sends act on the plate, in the plate's own axes with z down
    (https://docs.qualisys.com/qtm/content/qtm_windows/force_data_information.htm); here they act
    on the subject, in the same axes. A connection that is lost is sought again every second.
    """

    def __init__(
        self,
        host: str,
        *,
        stated: Stated,
        port: int = PORT,
        timeout_s: float = 5.0,
    ) -> None:
        self._client = import_extra("qtm_rt", "Qualisys")
        self._where = f"{host}:{port}"
        self._address = host, port
        self._stated, self._timeout_s = stated, timeout_s
        self._frames: Frames | None = None
        self._fault: Exception | None = None
        self._waiting: deque[Samples] = deque(maxlen=MAX_WAITING)
        self._arrived, self._ready = threading.Event(), threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="qualisys", daemon=True)
        self._thread.start()
        answered = self._ready.wait(3 * timeout_s)
        if self._fault is not None or not answered:
            self.close()
            raise self._fault or ConnectionError(f"{self._where} does not answer")

    @property
    def streams(self) -> tuple[StreamDescription, ...]:
        """What is received: markers, then plates, then analog devices."""
        return self._frames.streams if self._frames is not None else ()

    @property
    def plates(self) -> tuple[StatedPlate, ...]:
        """Plates as the program's settings describe them."""
        return self._frames.stated_plates if self._frames is not None else ()

    def receive(self, timeout_s: float) -> list[Samples]:
        """Give whatever has arrived; an empty list if nothing does within the timeout [s].

        A ValueError says that the program came back with other markers, channels or plates.
        """
        if not self._waiting:
            self._arrived.wait(timeout_s)
        self._arrived.clear()
        if self._fault is not None:
            raise self._fault
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """Disconnect."""
        if self._loop.is_running():
            self._loop.call_soon_threadsafe(self._cancel)
        self._thread.join(self._timeout_s)

    def _cancel(self) -> None:
        for task in asyncio.all_tasks(self._loop):
            task.cancel()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except asyncio.CancelledError:
            pass
        except Exception as fault:
            self._fault = fault
        finally:
            self._loop.close()
            self._ready.set()
            self._arrived.set()

    async def _serve(self) -> None:
        """Connect, and again whenever the connection is lost."""
        while True:
            try:
                await self._connection()
            except (OSError, self._client.QRTCommandException):
                if self._frames is None:
                    raise ConnectionError(
                        f"no Qualisys Track Manager answers at {self._where}; is it running, and "
                        "its port for real-time output open?"
                    ) from None
            await asyncio.sleep(RETRY_S)

    async def _connection(self) -> None:
        """Stream until the connection is lost."""
        lost = asyncio.Event()
        connection = await asyncio.wait_for(
            self._client.connect(
                *self._address,
                on_disconnect=lambda _: lost.set(),
                timeout=self._timeout_s,
                loop=self._loop,
            ),
            self._timeout_s,
        )
        if connection is None:
            raise ConnectionError
        try:
            written = await connection.get_parameters(["general", "3d", "analog", "force"])
            frames = read_parameters(written, self._stated)
            if self._frames is None:
                self._frames = frames
            elif change := frames.change_from(self._frames):
                raise came_back(f"Qualisys Track Manager at {self._where}", change)
            self._frames.restart()
            self._ready.set()
            while not lost.is_set():
                try:
                    await connection.stream_frames(
                        components=frames.components, on_packet=self._take
                    )
                    await lost.wait()
                except (TimeoutError, self._client.QRTCommandException):
                    await asyncio.sleep(RETRY_S)  # no measurement runs yet
        finally:
            if connection.has_transport():
                connection.disconnect()

    def _take(self, packet: Any) -> None:
        """Take one packet apart."""
        if self._frames is None or self._fault is not None:
            return
        try:
            self._waiting.extend(self._frames.samples(packet))
        except ValueError as fault:
            self._fault = fault
        self._arrived.set()
