// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run_server.hpp
/// How programs of the project serve: the address they are given, and their end.
#pragma once

#include <functional>
#include <string>
#include <utility>

namespace slicecorr::http {

/// "HOST:PORT", "[::1]:80"; port 0: one that is free. Throws `InputError` naming --listen.
std::pair<std::string, int> host_and_port(const std::string& listen);

/// Being told to end (SIGTERM) is the regular end of a service: exit code 0, where Ctrl-C gives
/// 130.
void take_sigterm();
bool ended();
/// 0 or 130.
int exit_code_of_end();

/// Calls `run` until a signal ends it by way of `stop`, which must make it return; returns the exit
/// code. `before_end` runs between. Throws `DeviceError` when `run` ends by itself.
int serve_until_ended(
    const std::function<void()>& run, const std::function<void()>& stop,
    const std::function<void()>& before_end = [] {});

}  // namespace slicecorr::http
