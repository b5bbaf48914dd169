// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommands of resinctl, by file.
#pragma once

#include "programs/common/program.hpp"

namespace slicecorr::resinctl {

void add_fit(cli::Program& program);          ///< fit
void add_derive(cli::Program& program);       ///< derive
void add_calibrate(cli::Program& program);    ///< calibrate
void add_optics(cli::Program& program);       ///< fit-optics
void add_spread(cli::Program& program);       ///< fit-spread
void add_tune(cli::Program& program);         ///< tune
void add_list(cli::Program& program);         ///< list
void add_database(cli::Program& program);     ///< show, validate, and the two below
void add_changes(cli::Program& program);      ///< add, history, diff, restore
void add_exchange(cli::Program& program);     ///< import, export
void add_plot(cli::Program& program);         ///< plot
void add_design(cli::Program& program);       ///< predict, recommend
void add_chemistry(cli::Program& program);    ///< chemistry
void add_new_printer(cli::Program& program);  ///< new-printer

}  // namespace slicecorr::resinctl
