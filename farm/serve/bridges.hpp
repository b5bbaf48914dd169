// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file bridges.hpp
/// Machines that jobs are sent to: DIR/machines.toml and DIR/bridges.toml name them, `printbridge` prints. A print is no
/// child that ends with the server: it goes on.
#pragma once

#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/job.hpp"
#include "slicecorr/farm/serve.hpp"

namespace slicecorr::farm::detail {

struct Bridge {
  std::string name, printer;
  std::vector<std::string> options;         ///< of `printbridge print`, as they are
  std::vector<std::string> status_options;  ///< of `printbridge status`
  std::string page;                         ///< address of `printbridge serve`, for a link
};

/// The machines that printbridge drives, of DIR/machines.toml and DIR/bridges.toml. Throws `InputError`.
std::vector<Bridge> read_bridges(const FarmFolder& folder);

/// Thread-safe. Throws `ApiError`.
class Bridges {
 public:
  Bridges(const FarmFolder& folder, const ChildRules& rules) : folder_(folder), rules_(rules) {}
  nlohmann::ordered_json list();
  /// Starts a print. What the bridge refuses within some seconds is thrown.
  nlohmann::ordered_json print(const std::string& bridge, const std::string& stack, const Job& job,
                               bool dry_run, bool machine_is_clear, const std::string& by);

 private:
  struct Sent {
    JobId job = 0;
    std::string name, by;
    bool running = false, dry_run = false;
    int exit_code = -1;
  };
  FarmFolder folder_;
  ChildRules rules_;
  struct Shared {
    std::mutex mutex;
    std::map<std::string, Sent> sent;  ///< the last of each bridge
  };
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

}  // namespace slicecorr::farm::detail
