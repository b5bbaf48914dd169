// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file serve.hpp
/// The farm over HTTP: pages to prepare prints and to follow them, a REST API under /api/v1, metrics.
///
/// What it is built against: pages of other sites in the same browser (no cookies, Host and Origin
/// are checked, changes need a bearer token), names that lead elsewhere (DNS rebinding, paths),
/// clients that send too much, too slowly or too many at once. It speaks plain HTTP: beyond the
/// machine it belongs behind a proxy that speaks TLS.
///
/// Of a `FarmServer`, `stop` may be called from any thread, the rest from one. Functions are
/// thread-safe, and so is what `make_submitter` gives. Only making a server throws; what is wrong
/// with a request is its answer.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/job.hpp"

namespace slicecorr::farm {

/// What a submission over HTTP gives back.
struct SubmitReply {
  int status = 201;  ///< of HTTP
  std::string json;
};

/// What an account may do; each may do what those before it may.
enum class Role {
  look,     ///< read everything
  submit,   ///< upload, study and queue parts; cancel and retry its own jobs
  operate,  ///< all jobs, the order of the queue, resins and printers, sending to machines
};
/// "look", "submit" or "operate".
const char* name_of(Role role);

/// Somebody who may use the server. Jobs that an account submits are jobs of the user `name`.
struct Account {
  std::string name;  ///< empty: whoever has the token
  Role role = Role::look;
  std::string token;
};

/// Reads accounts: lines `ROLE NAME TOKEN` in a file of the user's own with mode 0600 or 0400; empty
/// lines and those that begin with # are passed over. Throws `InputError` with file and line.
std::vector<Account> read_accounts_file(const std::string& path);

/// How child programs run that work for requests: `slicecorr`, `resinctl`, `printbridge`.
struct ChildRules {
  std::string programs;   ///< folder of the programs; empty: that of this program
  int studies = 1;        ///< that run at a time, >= 1
  int most_waiting = 16;  ///< studies that wait; more are refused (503)
  double study_s = 900;   ///< of each program of a study; then it is ended
  std::int64_t memory_bytes = std::int64_t{3} << 30;  ///< of data of each program
  std::int64_t file_bytes = std::int64_t{2} << 30;    ///< of each file that it writes
  int kept = 50;  ///< studies that are kept for their results; the oldest go
};

struct ServeOptions {
  std::string host = "127.0.0.1";
  int port = 0;       ///< 0..65535; 0: the system chooses
  std::string token;  ///< of an account without a name that may operate; empty: there is none
  /// Further accounts. Without any account nothing can be changed, and only loopback is served.
  std::vector<Account> accounts;
  ChildRules children;
  std::string host_names;  ///< further names in Host headers that are ours, separated by commas
  /// Takes the body of POST /api/v1/jobs. Empty: submissions are refused.
  std::function<SubmitReply(const std::string& body, bool dry_run,
                            const std::atomic<bool>& stopping)>
      submit;
  std::int64_t most_body_bytes = 8 << 20;                   ///< of JSON
  std::int64_t most_upload_bytes = 512 << 20;               ///< of one part
  std::int64_t most_uploads_bytes = std::int64_t{8} << 30;  ///< of all parts that were uploaded
  double uploads_kept_s = 24 * 3600;  ///< parts that no submission has taken by then go
  int threads =
      16;  ///< that work on requests, >= 1; one address has three quarters of them at most
  /// Threads beside them that wait for clients whose upload or answer is on the way, >= 0; one address has half of
  /// them at most. Beyond that who has moved no byte for a second is cut off for others, or else they are (503).
  int most_slow = 48;
  /// Connections whose request has not come whole, or waits for a thread, >= 1. Beyond that some are turned away (503): of
  /// the address that has most.
  int most_waiting = 256;
  int header_bytes = 16 << 10;   ///< of a request's headers, at most
  double request_s = 10;         ///< for the request line and headers to come
  double stall_s = 10;           ///< without a byte in either direction
  double least_bytes_s = 16384;  ///< bytes per s with which a body must come on average
  const FarmClock* clock = &system_clock();
};

class FarmServer {
 public:
  /// Binds. Throws `InputError` for an address that can't be, or one beyond loopback without a
  /// token; `DeviceError` when it is taken.
  FarmServer(const FarmFolder& folder, ServeOptions options);
  ~FarmServer();
  FarmServer(const FarmServer&) = delete;
  FarmServer& operator=(const FarmServer&) = delete;

  int port() const;
  /// "http://127.0.0.1:8123".
  std::string address() const;
  /// Serves until `stop`; then open requests are cut off.
  void run();
  /// Ends `run`. May be called from any thread.
  void stop();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Rules for jobs that come over HTTP.
struct SubmitRules {
  FarmFolder folder;
  /// Folders in which parts may lie, and outputs be written; paths elsewhere are refused. Uploaded
  /// parts ("upload:TOKEN/NAME") are always allowed.
  std::vector<std::string> allowed_folders;
  std::string user;  ///< where a job names none
  /// Jobs of one user that may wait or run; what would be more is refused.
  std::int64_t most_open_jobs = 10'000;
};
/// A `ServeOptions::submit` that checks the jobs as `slicefarm submit` does.
std::function<SubmitReply(const std::string&, bool, const std::atomic<bool>&)> make_submitter(
    SubmitRules rules);

}  // namespace slicecorr::farm
