/// @file api.hpp
/// What the server answers, apart from how connections are kept in bounds.
#pragma once

#include <httplib.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

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
  /// Headers that every answer has.

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
  /// The live page, which holds nothing of the farm; false: `path` is not of it.
  bool read_shell(const std::string& path, httplib::Response& response) const;
  /// What is at /api/v1/`what`, but for single jobs.
  void read_farm(const std::string& what, Query& query, httplib::Response& response);
  void list_jobs(Query& query, httplib::Response& response);
  void list_events(Query& query, httplib::Response& response);
  MorningReport morning();
  void job(JobId id, const std::vector<std::string>& rest, const httplib::Request& request,
           httplib::Response& response);
  void file(const Job& job, const std::string& ending, httplib::Response& response);
  void upload(const std::string& name, const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);
  void submit(const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);
  void steer(const std::vector<std::string>& path, const httplib::Request& request,
             httplib::Response& response, const httplib::ContentReader& body);
  std::string whole_body(const httplib::Request& request, const httplib::ContentReader& body) const;

  FarmFolder folder_;
  const ServeOptions& options_;
  GuardRules rules_;
  const std::atomic<bool>& stopping_;
  std::mutex readers_mutex_, submit_mutex_;
  std::vector<std::unique_ptr<ReadModel>> readers_;
  Kept overview_{1}, metrics_{1}, report_{5}, report_json_{5}, timeline_{5};
};

/// "/api/v1/jobs/7" to its parts.
std::vector<std::string> segments_of(const std::string& path);
/// A whole number above 0, or 0.
std::int64_t id_of(const std::string& text);

}  // namespace slicecorr::farm::detail
