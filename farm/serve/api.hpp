// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file api.hpp
/// What the server answers, apart from how connections are kept in bounds.
#pragma once

#include <httplib.h>

#include <chrono>
#include <functional>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <semaphore>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "serve/accounts.hpp"
#include "serve/bridges.hpp"
#include "serve/machine_watch.hpp"
#include "serve/studies.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/serve.hpp"
#include "support/http/answers.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm::detail {

using namespace slicecorr::http;

/// Parameters of a query, each known one taken once.
class Query {
 public:
  explicit Query(const httplib::Request& request) : params_(request.params) {}
  std::string text(const char* name);
  std::int64_t number(const char* name, std::int64_t otherwise, std::int64_t least,
                      std::int64_t most);
  bool flag(const char* name);
  /// Throws `ApiError` for names that nobody asked for.
  void end() const;

 private:
  httplib::Params params_;
};

class Api {
 public:
  Api(const FarmFolder& folder, const ServeOptions& options, GuardRules rules,
      const std::atomic<bool>& stopping);
  /// GET and HEAD; the checks of all others. True: answered.
  bool before_body(const httplib::Request& request, httplib::Response& response);
  /// POST and PUT, checked before.
  void change(const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);

 private:
  /// A view on the record for one request. Views are kept for later requests: opening one costs
  /// more than most answers.
  class Reader {
   public:
    explicit Reader(Api& api);
    ~Reader();
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;
    ReadModel* operator->() { return model_.get(); }
    ReadModel& operator*() { return *model_; }

   private:
    Api& api_;
    std::unique_ptr<ReadModel> model_;
  };
  void read(const httplib::Request& request, httplib::Response& response);
  /// The pages, which hold nothing of the farm; false: `path` is not of them.
  static bool read_shell(const std::string& path, httplib::Response& response);
  /// What is at /api/v1/`what`, but for single jobs and studies.
  void read_farm(const std::string& what, const Asker& asker, Query& query,
                 httplib::Response& response);
  void read_study(const std::vector<std::string>& rest, httplib::Response& response);
  void resin_curve(const std::string& name, httplib::Response& response);
  void list_jobs(Query& query, httplib::Response& response);
  void list_events(Query& query, httplib::Response& response);
  MorningReport morning();
  void job(JobId id, const std::vector<std::string>& rest, Query& query,
           httplib::Response& response);
  void list_scans(JobId id, httplib::Response& response);
  void scan_file(JobId id, const std::string& number, const std::string& what,
                 httplib::Response& response);
  /// How prints that were scanned wander: as JSON, as a picture or a page of one printer and resin.
  void prints_wander(const std::string& what, Query& query, httplib::Response& response);
  void new_scan(const Job& job, const std::string& text, const Asker& asker,
                httplib::Response& response);
  void remove_scan(const Job& job, const std::string& number, const std::string& by,
                   httplib::Response& response);
  void next_print(const Job& job, const std::string& text, const Asker& asker,
                  httplib::Response& response);
  static void file(const Job& job, const std::string& ending, httplib::Response& response);
  void upload(const std::string& name, const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);
  void submit(const Asker& asker, const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);
  /// One of the few submissions that are checked at a time, one of each asker: reading meshes takes
  /// memory. Throws `ApiError` where none is free.
  class SubmitPlace {
   public:
    SubmitPlace(Api& api, std::string name);
    ~SubmitPlace();
    SubmitPlace(const SubmitPlace&) = delete;
    SubmitPlace& operator=(const SubmitPlace&) = delete;

   private:
    Api& api_;
    std::string name_;
  };
  static constexpr std::size_t kMostSubmissions = 2;
  void pause(bool pause, const std::string& by, httplib::Response& response);
  /// `path`: of the request, from what is to be done with the job on.
  void steer(JobId id, const std::vector<std::string>& path, const std::string& text,
             const Asker& asker, httplib::Response& response);
  void set_priority(JobId id, const std::string& text, const std::string& by,
                    httplib::Response& response);
  void print(JobId id, const std::string& text, const std::string& by, httplib::Response& response);
  void start_study(const std::string& text, const Asker& asker, httplib::Response& response);
  void add_resin(const std::string& text, const std::string& by, httplib::Response& response);
  void add_printer(const std::string& text, httplib::Response& response);
  void act_on_machine(const std::string& name, const std::string& what, const std::string& text,
                      httplib::Response& response);
  void give_ticket(const std::string& text, httplib::Response& response);
  /// Runs a program that takes a moment. Throws `ApiError` with what it says when it fails.
  std::string ask_program(std::vector<std::string> arguments, const std::string& input = {},
                          const std::string& folder = {});
  /// The job, where the asker may change it.
  Job job_of(JobId id, const Asker& asker);
  std::string whole_body(const httplib::Request& request, const httplib::ContentReader& body) const;

  FarmFolder folder_;
  const ServeOptions& options_;
  GuardRules rules_;
  const std::atomic<bool>& stopping_;
  Accounts accounts_;
  Tickets tickets_;
  Studies studies_;
  Bridges bridges_;
  MachineWatch machines_;
  std::counting_semaphore<> programs_{2};  ///< that requests wait for, at a time
  std::mutex readers_mutex_, submit_mutex_;
  std::set<std::string> submitting_;  ///< who submits now
  std::vector<std::unique_ptr<ReadModel>> readers_;
  Kept overview_{1}, metrics_{1}, report_{5}, report_json_{5}, timeline_{5};
};

/// Sends a file as it is now; `download`: the name under which it is to be kept, empty: it is shown.
/// 410 when it is gone, or has another size than `bytes` (-1: whatever it has).
void send_file(const std::string& path, std::int64_t bytes, const char* type,
               const std::string& download, httplib::Response& response);

void send_json(httplib::Response& response, int status, const nlohmann::ordered_json& json);
/// An object of JSON; throws `ApiError`.
nlohmann::ordered_json parsed(const std::string& text);
/// Refuses keys that a request does not take. Throws `ApiError`.
void check_keys(const nlohmann::ordered_json& json, std::initializer_list<std::string_view> known);
/// Throws `ApiError`.
[[noreturn]] void not_there();

/// A page that somebody's part brought with it has scripts in it, and lies where users write: it gets
/// an origin of its own, from which it can ask for nothing.
inline constexpr const char* kPartPolicy =
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src "
    "'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors "
    "'none'";

/// "/api/v1/jobs/7" to its parts.
std::vector<std::string> segments_of(const std::string& path);
/// A whole number above 0, or 0.
std::int64_t id_of(const std::string& text);

}  // namespace slicecorr::farm::detail
