"""A server that speaks the real-time protocol of Qualisys Track Manager, or something else.

Written from the vendor's documentation, https://docs.qualisys.com/qtm-rt-protocol/: packets of size
and type, little-endian; a welcome; commands as text; parameters as XML; frames as components.
"""

import socket
import struct
import threading
from contextlib import suppress

import numpy as np

ERROR, COMMAND, XML, DATA, NO_MORE_DATA = range(5)


def packet(kind, body):
    return struct.pack("<II", 8 + len(body), kind) + body


def text(kind, words):
    return packet(kind, words.encode() + b"\0")


def location(corners_mm):
    """XML of where a plate lies, (4, 3)."""
    inside = "".join(
        f"<Corner{k}><X>{x:.6f}</X><Y>{y:.6f}</Y><Z>{z:.6f}</Z></Corner{k}>"
        for k, (x, y, z) in enumerate(corners_mm, start=1)
    )
    return f"<Location>{inside}</Location><Origin><X>0</X><Y>0</Y><Z>-41.3</Z></Origin>"


def parameters(
    names,
    *,
    rate=100,
    force_rate=1000,
    plates=(),
    channels=(),
    version="1.25",
    locations=(),
):
    """XML of the settings; ``channels`` are labels and units of one analog device."""
    labels = "".join(f"<Label><Name>{n}</Name><RGBColor>ff</RGBColor></Label>" for n in names)
    device = "".join(f"<Channel><Label>{c}</Label><Unit>{u}</Unit></Channel>" for c, u in channels)
    analog = (
        f"<Analog><Device><Device_ID>1</Device_ID><Device_Name>Board 1</Device_Name>"
        f"<Channels>{len(channels)}</Channels><Frequency>{force_rate}</Frequency>{device}"
        "</Device></Analog>"
    )
    of_plates = "".join(
        f"<Plate><Plate_ID>{k}</Plate_ID><Analog_Device_ID>0</Analog_Device_ID>"
        f"<Frequency>{force_rate}</Frequency><Type>AMTI</Type><Name>{name}</Name>"
        f"{locations[k - 1] if locations else ''}</Plate>"
        for k, name in enumerate(plates, start=1)
    )
    return (
        f"<QTM_Parameters_Ver_{version}><General><Frequency>{rate}</Frequency></General>"
        f"<The_3D><AxisUpwards>+Z</AxisUpwards><Labels>{len(names)}</Labels>{labels}</The_3D>"
        f"{analog if channels else ''}<Force><Unit_Length>mm</Unit_Length>"
        f"<Unit_Force>N</Unit_Force>{of_plates}</Force></QTM_Parameters_Ver_{version}>"
    )


def frame(number, time_s, positions_mm, *, analog=None, forces=()):
    """One data packet: markers (M, 3), analog (first number, (N, K)), forces per plate likewise."""
    parts = []
    if positions_mm is not None:
        parts += [(1, struct.pack("<Ihh", len(positions_mm), 0, 0) + as_floats(positions_mm))]
    if analog is not None:
        first, samples = analog
        head = struct.pack("<iiii", 1, 1, samples.shape[1], len(samples))
        parts.append((3, head + struct.pack("<i", first) + as_floats(samples.T)))
    if forces:
        body = struct.pack("<i", len(forces))
        for plate, (first, samples) in enumerate(forces, start=1):
            body += struct.pack("<iii", plate, len(samples), first) + as_floats(samples)
        parts.append((4, body))
    return composed(*parts, number=number, time_s=time_s)


def composed(*parts, number=0, time_s=0.0, count=None):
    """One data packet of components, (kind, bytes) each."""
    components = b"".join(struct.pack("<II", 8 + len(b), kind) + b for kind, b in parts)
    count = len(parts) if count is None else count
    return packet(DATA, struct.pack("<qII", round(time_s * 1e6), number, count) + components)


def as_floats(values):
    return np.ascontiguousarray(values, "<f4").tobytes()


WELCOME = text(COMMAND, "QTM RT Interface connected")


class QtmServer:
    """Answers one client after the other; sends what `send` is given to those that stream.

    ``replies`` are other bytes for commands that begin with a word, "" for the welcome.
    """

    def __init__(self, settings, replies=None):
        self.settings, self.replies = settings, {"": WELCOME, **(replies or {})}
        self.connections = 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._clients, self.streaming = [], False
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                client, _ = self._listening.accept()
            except OSError:
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(client)
            self.connections += 1
            threading.Thread(target=self._answer, args=(client,), daemon=True).start()

    def _answer(self, client):
        received = b""
        with suppress(OSError):
            client.sendall(self.replies[""])
            while piece := client.recv(4096):
                received += piece
                while len(received) >= 8 and len(received) >= struct.unpack_from("<I", received)[0]:
                    (size,) = struct.unpack_from("<I", received)
                    command = received[8:size].rstrip(b"\0").decode()
                    received = received[size:]
                    self._obey(client, command.lower().split())

    def _obey(self, client, words):
        if words[0] in self.replies:
            client.sendall(self.replies[words[0]])
        elif words[0] == "version":
            client.sendall(text(COMMAND, f"Version set to {words[1]}"))
        elif words[0] == "getparameters":
            client.sendall(text(XML, self.settings))
        elif words[0] == "streamframes":
            self.streaming = True
            client.sendall(packet(NO_MORE_DATA, b""))
        elif words[0] == "qtmversion":
            client.sendall(text(COMMAND, "QTM Version is 2024.3"))
        else:
            client.sendall(text(ERROR, "Parse error"))

    def send(self, data):
        for client in self._clients[-1:]:
            client.sendall(data)

    def drop_clients(self):
        """Close all connections, as when the program is ended."""
        self.streaming = False
        clients, self._clients = self._clients, []
        for client in clients:
            with suppress(OSError):  # the other side has closed it
                client.shutdown(socket.SHUT_RDWR)
            client.close()

    def close(self):
        self._listening.shutdown(socket.SHUT_RDWR)  # ends the thread that waits for clients
        self._listening.close()
        self.drop_clients()
