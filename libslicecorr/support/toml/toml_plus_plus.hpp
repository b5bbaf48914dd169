// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// toml++, whose parser is compiled once, in toml_table.cpp. It asserts that texts are what they may
/// not be: a table's name that begins with a control character would end a program of a debug build,
/// and be taken for impossible by an optimiser.
#pragma once

#define TOML_HEADER_ONLY 0
#define TOML_ASSERT(condition) static_assert(true)
#include <toml++/toml.h>
