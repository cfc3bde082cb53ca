"""Modbus TCP requests with answers that can be believed; the only module that knows pymodbus.

pymodbus repeats what was not answered, writes included, and takes an answer of another kind or length for a
good one. So here nothing is repeated below, and every answer is compared with its request.
"""

import logging
import threading
from typing import Any

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost

# a failed connection is raised as our own error: without a handler it would also be printed
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

READ_ATTEMPTS = 2
READ_HOLDING, READ_INPUT, WRITE_MANY = 3, 4, 16
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge only",
    6: "device busy",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}


class ModbusLink:
    """One TCP connection with one request in flight; made when first needed, and again after it was lost.

    Parameters
    ----------
    name : str
        The device's name and address, for messages.
    host : str
    port : int
    unit : int
        The unit identifier behind that address.
    reply_timeout_s : float
        Deadline for connecting, and for an answer; real time.
    """

    def __init__(self, name: str, host: str, port: int, unit: int, reply_timeout_s: float) -> None:
        self.name = name
        self._host, self._port, self._unit = host, port, unit
        self._reply_timeout_s = reply_timeout_s
        self._lock = threading.RLock()
        self._client: Any = None

    def read(self, table: str, address: int, count: int) -> list[int]:
        """Return `count` registers of the `input` or `holding` table; repeated once, for reading is harmless.

        Raises
        ------
        DeviceTimeout, LinkLost
            If no answer, or none that belongs to the request, came.
        DeviceFault
            If the device answered with an exception.
        """
        function = READ_INPUT if table == "input" else READ_HOLDING
        step = f"read {table} registers {address} to {address + count - 1}"
        for attempt in range(READ_ATTEMPTS):
            try:
                with self._lock:
                    registers = list(self._exchange(step, function, address=address, count=count).registers)
                    if len(registers) != count:
                        raise self._drop(self._stranger(step, f"{count} registers", f"{len(registers)}"))
                return registers
            except (DeviceTimeout, LinkLost):
                if attempt == READ_ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def write(self, address: int, words: list[int]) -> None:
        """Write holding registers in one request; never repeated.

        Raises
        ------
        DeviceTimeout, LinkLost
            If it was not acknowledged. The device may have taken it all the same: read back and decide.
        DeviceFault
            If the device answered with an exception.
        """
        step = f"write holding registers {address} to {address + len(words) - 1}"
        with self._lock:
            response = self._exchange(step, WRITE_MANY, address=address, values=words)
            if (response.address, response.count) != (address, len(words)):
                got = f"{response.count} from {response.address}"
                raise self._drop(self._stranger(step, f"{len(words)} registers from {address}", got))

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _exchange(self, step: str, function: int, **request: Any) -> Any:
        from pymodbus.exceptions import ConnectionException, ModbusException

        client = self._connected(step)
        send = {
            READ_HOLDING: client.read_holding_registers,
            READ_INPUT: client.read_input_registers,
            WRITE_MANY: client.write_registers,
        }[function]
        try:
            response = send(**request, device_id=self._unit)
        except (ConnectionException, OSError) as error:
            raise self._drop(self._lost(step, "an open connection", str(error))) from error
        except ModbusException:
            raise self._drop(
                DeviceTimeout(
                    self.name,
                    step,
                    expected=f"an answer within {self._reply_timeout_s:g} s",
                    got="none",
                    remedy="check that the controller runs and its unit number",
                )
            ) from None
        return self._genuine(step, function, response)

    def _connected(self, step: str) -> Any:
        from pymodbus.client import ModbusTcpClient

        if self._client is None:
            client = ModbusTcpClient(
                self._host, port=self._port, timeout=self._reply_timeout_s, retries=0, name=self.name
            )
            if not client.connect():
                raise self._lost(step, f"a connection to {self._host}:{self._port}", "none")
            self._client = client
        return self._client

    def _genuine(self, step: str, function: int, response: Any) -> Any:
        from pymodbus.pdu import ExceptionResponse

        if isinstance(response, ExceptionResponse) and response.function_code == function | 0x80:
            code = response.exception_code
            raise DeviceFault(
                self.name,
                step,
                expected="acceptance",
                got=f"exception {code} ({EXCEPTIONS.get(code, 'unknown')})",
                remedy="compare the register map and the limits with the machine's manual",
            )
        if response.function_code != function:
            raise self._drop(
                self._stranger(
                    step, f"an answer to function {function}", f"one to function {response.function_code}"
                )
            )
        return response

    def _drop(self, error: DeviceError) -> DeviceError:
        """Close the connection, so that a late answer cannot be taken for the next one's."""
        self.close()
        return error

    def _lost(self, step: str, expected: str, got: str) -> LinkLost:
        remedy = "check the cable, the address and that the controller runs"
        return LinkLost(self.name, step, expected=expected, got=got, remedy=remedy)

    def _stranger(self, step: str, expected: str, got: str) -> LinkLost:
        remedy = "check that nothing else answers at this address"
        return LinkLost(self.name, step, expected=expected, got=got, remedy=remedy)
