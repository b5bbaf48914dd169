# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A machine that we did not write: pymodbus as the server, with another register map.

The map (as in the printer file that the test makes): 16 bit words, little word order, commands 10,
20, 30, 40, states 7, 8, 9, 11. The machine is simple: stage and lamps do at once what they are told.
Prints its port, then what it was told, as JSON lines, when stdin closes.
"""

import asyncio
import json
import sys
import threading
import time

from pymodbus.datastore import (ModbusServerContext, ModbusSequentialDataBlock,
                                ModbusSlaveContext)
from pymodbus.server.async_io import ModbusTcpServer

OFF, RUN, STOP, RESET = 10, 20, 30, 40
IDLE, RUNNING, STOPPED = 7, 8, 9


class Machine(ModbusSequentialDataBlock):
    """Holding registers; 300.. are written by the bridge, 500.. read."""

    def __init__(self):
        super().__init__(0, [0] * 1000)
        self.position_um, self.target_um, self.speed_um_s = 0.0, 0.0, 0.0
        self.acceleration, self.velocity = 1000.0, 0.0
        self.command, self.moved = OFF, time.monotonic()
        self.heard = []
        self.lock = threading.Lock()
        super().setValues(502, [IDLE])

    def word(self, address):
        return self.values[address]

    def double(self, address):
        # Low word first.
        raw = self.values[address] | self.values[address + 1] << 16
        return raw - (1 << 32) if raw & 1 << 31 else raw

    def move(self):
        now = time.monotonic()
        left = now - self.moved
        self.moved = now
        while left > 0:
            dt = min(left, 0.0005)
            left -= dt
            way = self.target_um - self.position_um
            side = 1 if way > 0 else -1
            most = min(self.speed_um_s, (2 * self.acceleration * abs(way)) ** 0.5)
            wanted = side * most if self.command == RUN else 0.0
            step = self.acceleration * dt
            self.velocity += max(-step, min(step, wanted - self.velocity))
            if abs(way) < 0.05 and abs(self.velocity) < 2 * step:
                self.position_um, self.velocity = self.target_um, 0.0
            else:
                self.position_um += self.velocity * dt

    def setValues(self, address, values):
        with self.lock:
            super().setValues(address, values)
            if not 300 <= address - 1 < 330 and not 300 <= address < 330:
                return
            self.move()
            # pymodbus puts address 0 at place 1 of the block.
            base = 301
            self.command = self.word(base + 2)
            self.target_um = self.double(base + 3) * 0.1
            self.speed_um_s = self.double(base + 5) * 0.01
            self.acceleration = max(1.0, self.word(base + 8) * 1.0)
            blue = self.word(base + 7)
            self.heard.append([self.command, blue])
            running = self.command == RUN
            out = [0] * 12
            out[0] = self.word(base)
            out[1] = RUNNING if running else STOPPED if self.command == STOP else IDLE
            raw = round(self.position_um * 10) & 0xffffffff
            out[2], out[3] = raw & 0xffff, raw >> 16
            out[4] = blue if running else 0
            super().setValues(501, out)

    def getValues(self, address, count=1):
        with self.lock:
            self.move()
            raw = round(self.position_um * 10) & 0xffffffff
            super().setValues(503, [raw & 0xffff, raw >> 16])
            return super().getValues(address, count)


async def main():
    machine = Machine()
    context = ModbusServerContext(slaves=ModbusSlaveContext(hr=machine), single=True)
    server = ModbusTcpServer(context, address=("127.0.0.1", 0), allow_reuse_address=True)
    task = asyncio.ensure_future(server.serve_forever())
    while server.server is None:
        await asyncio.sleep(0.01)
    print(server.server.sockets[0].getsockname()[1], flush=True)
    loop = asyncio.get_running_loop()
    await loop.run_in_executor(None, sys.stdin.read)
    task.cancel()
    with machine.lock:
        for heard in machine.heard:
            print(json.dumps(heard))
    sys.stdout.flush()


asyncio.run(main())
