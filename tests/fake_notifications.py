# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A desktop's service of notifications that writes what it is told into a file, a line of JSON each.

python3 fake_notifications.py FILE; FILE is there, empty, once the service has its name on the session's bus.
"""
import json
import sys

import dbus
import dbus.mainloop.glib
import dbus.service
from gi.repository import GLib

NAME = "org.freedesktop.Notifications"


class Service(dbus.service.Object):
    @dbus.service.method(NAME, in_signature="susssasa{sv}i", out_signature="u")
    def Notify(self, program, _replaces, _icon, title, text, _actions, _hints, _timeout):
        with open(sys.argv[1], "a", encoding="utf-8") as file:
            file.write(json.dumps({"program": program, "title": title, "text": text}) + "\n")
        return 1

    @dbus.service.method(NAME, in_signature="", out_signature="ssss")
    def GetServerInformation(self):
        return "fake", "slicecorr", "1", "1.2"

    @dbus.service.method(NAME, in_signature="", out_signature="as")
    def GetCapabilities(self):
        return ["body"]


dbus.mainloop.glib.DBusGMainLoop(set_as_default=True)
bus = dbus.SessionBus()
name = dbus.service.BusName(NAME, bus, do_not_queue=True)
service = Service(bus, "/org/freedesktop/Notifications")
with open(sys.argv[1], "w", encoding="utf-8"):
    pass
GLib.MainLoop().run()
