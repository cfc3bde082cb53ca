"""Modbus servers of other authors (pyModbusTCP, modbus-tk, libmodbus) that serve the simulated machine.

The other authors' code parses all requests and builds all answers on the wire. The function `answer` of the
simulated machine only gives the content of the registers, or refuses a request.
"""

import ctypes
import ctypes.util
import os
import select
import socket
import struct
import threading
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable

Answer = Callable[[bytes], bytes]

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
REGISTERS = 1024


class RefusedError(Exception):
    """The simulated machine has answered with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        self.code = code


class ForeignServer(ABC):
    """A server of another author. Its function `answer` of the machine can be replaced while it runs."""

    address: str
    answer: Answer

    def read(self, function: int, address: int, count: int) -> list[int]:
        reply = self._genuine(struct.pack(">BHH", function, address, count))
        return list(struct.unpack(f">{count}H", reply[2:]))

    def write(self, address: int, words: list[int]) -> None:
        head = struct.pack(">BHHB", WRITE_MANY, address, len(words), 2 * len(words))
        self._genuine(head + struct.pack(f">{len(words)}H", *words))

    def _genuine(self, request: bytes) -> bytes:
        reply = self.answer(request)
        if reply[0] & 0x80:
            raise RefusedError(reply[1])
        return reply

    @abstractmethod
    def close(self) -> None:
        """Overridden by each kind."""


class PtyPair:
    """Two pseudo-terminals that are connected with each other, like two serial ports with a cable."""

    def __init__(self) -> None:
        pairs = [os.openpty() for _ in range(2)]
        for pair in pairs:
            tty.setraw(pair[1])
        self._ends = pairs
        self.paths = [os.ttyname(far) for _, far in pairs]
        self._wake = os.pipe()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        one, other = (near for near, _ in self._ends)
        while True:
            ready, _, _ = select.select([one, other, self._wake[0]], [], [])
            if self._wake[0] in ready:
                return
            for source, sink in ((one, other), (other, one)):
                if source in ready:
                    os.write(sink, os.read(source, 4096))

    def close(self) -> None:
        os.write(self._wake[1], b"!")
        self._thread.join()
        for descriptor in (*self._ends[0], *self._ends[1], *self._wake):
            os.close(descriptor)


class PyModbusTcpServer(ForeignServer):
    """A Modbus TCP server by pyModbusTCP."""

    def __init__(self) -> None:
        from pyModbusTCP.server import DataHandler, ModbusServer

        outer = self

        class Registers(DataHandler):
            def read_h_regs(self, address, count, srv_info):
                return self._told(lambda: outer.read(READ_HOLDING, address, count))

            def read_i_regs(self, address, count, srv_info):
                return self._told(lambda: outer.read(READ_INPUT, address, count))

            def write_h_regs(self, address, words_l, srv_info):
                return self._told(lambda: outer.write(address, words_l))

            def _told(self, ask):
                try:
                    return self.Return(exp_code=0, data=ask())
                except RefusedError as refusal:
                    return self.Return(exp_code=refusal.code)

        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self._server = ModbusServer("127.0.0.1", port, no_block=True, data_hdl=Registers())
        self._server.start()
        self.address = f"127.0.0.1:{port}"

    def close(self) -> None:
        self._server.stop()


class _TkServer(ForeignServer):
    """Base class of the servers by modbus-tk, whose register memory is read from the machine."""

    def _begin(self, server) -> None:
        from modbus_tk import defines, hooks, modbus

        outer = self

        class Memory:
            starting_address, size = 0, 2**16

            def __init__(self, function: int) -> None:
                self._function = function

            def __getitem__(self, place: slice) -> list[int]:
                try:
                    return outer.read(self._function, place.start, place.stop - place.start)
                except RefusedError as refusal:
                    raise modbus.ModbusError(refusal.code) from refusal

            def __setitem__(self, place: int, word: int) -> None:
                """Do nothing, because the machine has received the whole request."""

        def written(arguments) -> None:
            slave, request = arguments
            if slave is self._slave and (code := (reply := self.answer(request))[1]) and reply[0] & 0x80:
                raise modbus.ModbusError(code)

        # its own name for this is deprecated, and its thread would die of the warning
        server._go.isSet = server._go.is_set
        self._server, self._written = server, written
        memory = {
            defines.HOLDING_REGISTERS: [Memory(READ_HOLDING)],
            defines.ANALOG_INPUTS: [Memory(READ_INPUT)],
        }
        self._slave = server.add_slave(1, memory=memory)
        self._hooks = [
            f"modbus.Slave.handle_write_{which}_request"
            for which in ("multiple_registers", "single_register")
        ]
        for hook in self._hooks:
            hooks.install_hook(hook, written)
        server.start()

    def close(self) -> None:
        from modbus_tk import hooks

        self._server.stop()
        for hook in self._hooks:
            hooks.uninstall_hook(hook, self._written)


class TkTcpServer(_TkServer):
    """A Modbus TCP server by modbus-tk."""

    def __init__(self) -> None:
        from modbus_tk import modbus_tcp

        listening = threading.Event()

        class Server(modbus_tcp.TcpServer):
            def _do_init(self) -> None:
                super()._do_init()
                listening.set()

        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"127.0.0.1:{port}"
        self._begin(Server(port, "127.0.0.1"))
        assert listening.wait(60.0)


class TkRtuServer(_TkServer):
    """A Modbus RTU server by modbus-tk, on a pseudo-terminal."""

    def __init__(self) -> None:
        import serial
        from modbus_tk import modbus_rtu

        self._cable = PtyPair()
        self.address, theirs = self._cable.paths
        self._begin(modbus_rtu.RtuServer(serial.Serial(theirs, 19200)))

    def close(self) -> None:
        super().close()
        self._server.close()
        self._cable.close()


class _Mapping(ctypes.Structure):
    _fields_ = (
        [(name, ctypes.c_int) for name in ("bits", "bits_at", "input_bits", "input_bits_at")]
        + [(name, ctypes.c_int) for name in ("inputs", "inputs_at", "registers", "registers_at")]
        + [(name, ctypes.POINTER(ctypes.c_uint8)) for name in ("tab_bits", "tab_input_bits")]
        + [(name, ctypes.POINTER(ctypes.c_uint16)) for name in ("tab_inputs", "tab_registers")]
    )


def libmodbus() -> ctypes.CDLL | None:
    """Return the library libmodbus, or None if it is not installed."""
    name = ctypes.util.find_library("modbus")
    if name is None:
        return None
    library = ctypes.CDLL(name, use_errno=True)
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_mapping_new.restype = ctypes.POINTER(_Mapping)
    return library


class _LibmodbusServer(ForeignServer):
    """Base class of the servers by libmodbus. The method `_respond` answers one request."""

    trailer = 0

    def _begin(self, library: ctypes.CDLL, context: int) -> None:
        self._library, self._context = library, ctypes.c_void_p(context)
        self._mapping = library.modbus_mapping_new(0, 0, REGISTERS, REGISTERS)
        self._wake = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @abstractmethod
    def _serve(self) -> None:
        """Overridden by each kind."""

    def _respond(self) -> bool:
        """Receive one request and answer it. Return False when the client has disconnected."""
        query = (ctypes.c_uint8 * 260)()
        size = self._library.modbus_receive(self._context, query)
        if size <= 0:
            return size == 0
        header = self._library.modbus_get_header_length(self._context)
        request = bytes(query[header : size - self.trailer])
        try:
            function, address, count = struct.unpack(">BHH", request[:5])
            if function in (READ_HOLDING, READ_INPUT):
                table = self._mapping.contents
                words = table.tab_inputs if function == READ_INPUT else table.tab_registers
                for place, word in enumerate(self.read(function, address, count), address):
                    words[place] = word
            else:
                self._genuine(request)
        except RefusedError as refusal:
            self._library.modbus_reply_exception(self._context, query, refusal.code)
        else:
            self._library.modbus_reply(self._context, query, size, self._mapping)
        return True

    def close(self) -> None:
        os.write(self._wake[1], b"!")
        self._thread.join()
        for descriptor in self._wake:
            os.close(descriptor)
        self._library.modbus_mapping_free(self._mapping)


class LibmodbusTcpServer(_LibmodbusServer):
    """A Modbus TCP server by libmodbus."""

    def __init__(self) -> None:
        library = libmodbus()
        assert library is not None
        context = library.modbus_new_tcp(b"127.0.0.1", 0)
        self._listener = library.modbus_tcp_listen(ctypes.c_void_p(context), 5)
        with socket.socket(fileno=os.dup(self._listener)) as listener:
            self.address = f"127.0.0.1:{listener.getsockname()[1]}"
        self._begin(library, context)

    def _serve(self) -> None:
        clients: set[int] = set()
        while True:
            ready, _, _ = select.select([self._listener, self._wake[0], *clients], [], [])
            if self._wake[0] in ready:
                for descriptor in (*clients, self._listener):
                    os.close(descriptor)
                return
            if self._listener in ready:
                listener = ctypes.c_int(self._listener)
                clients.add(self._library.modbus_tcp_accept(self._context, ctypes.byref(listener)))
            for client in clients.intersection(ready):
                self._library.modbus_set_socket(self._context, client)
                if not self._respond():
                    os.close(client)
                    clients.discard(client)

    def close(self) -> None:
        super().close()
        self._library.modbus_free(self._context)


class LibmodbusRtuServer(_LibmodbusServer):
    """A Modbus RTU server by libmodbus, on a pseudo-terminal."""

    trailer = 2

    def __init__(self) -> None:
        library = libmodbus()
        assert library is not None
        self._cable = PtyPair()
        self.address, theirs = self._cable.paths
        context = library.modbus_new_rtu(theirs.encode(), 19200, ctypes.c_char(b"N"), 8, 1)
        library.modbus_set_slave(ctypes.c_void_p(context), 1)
        assert library.modbus_connect(ctypes.c_void_p(context)) == 0
        self._begin(library, context)

    def _serve(self) -> None:
        line = self._library.modbus_get_socket(self._context)
        while True:
            ready, _, _ = select.select([line, self._wake[0]], [], [])
            if self._wake[0] in ready:
                return
            self._respond()

    def close(self) -> None:
        super().close()
        self._library.modbus_close(self._context)
        self._library.modbus_free(self._context)
        self._cable.close()
