// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Who is told of what: webhooks and commands that refuse, hang and go away.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <poll.h>

#include <condition_variable>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "farm_filled.hpp"
#include "farm_program.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/notify.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using slicecorr::test::kSlicefarm;
using slicecorr::test::run_program;
using test::Farm;
using ::testing::HasSubstr;

/// Takes messages; may refuse, or say nothing, as often as wanted.
class Receiver {
 public:
  Receiver() {
    server.Post("/hook", [this](const httplib::Request& request, httplib::Response& response) {
      const std::scoped_lock lock(mutex_);
      headers = request.headers;
      if (refuse > 0) {
        --refuse;
        ++refused;
        response.status = 503;
      } else {
        messages.push_back(json::parse(request.body));
        response.status = 204;
      }
      changed_.notify_all();
    });
    port = server.bind_to_any_port("127.0.0.1");
    thread_ = std::thread([this] { server.listen_after_bind(); });
  }
  ~Receiver() {
    server.stop();
    thread_.join();
  }
  std::string url() const { return fmt::format("http://127.0.0.1:{}/hook", port); }
  bool wait(const std::function<bool()>& holds) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(60), holds);
  }
  std::vector<std::string> kinds() const {
    std::vector<std::string> list;
    for (const json& m : messages) list.push_back(m["kind"]);
    std::sort(list.begin(), list.end());
    return list;
  }
  httplib::Server server;
  int port = 0, refuse = 0, refused = 0;
  std::vector<json> messages;
  httplib::Headers headers;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread thread_;
};

NotifyOptions quick() {
  NotifyOptions options;
  options.look_s = 0.02;
  options.first_delay_s = 0.02;
  return options;
}

/// Ends when the notifier has begun to look: what comes from now on is told.
void wait_until_looking(const Farm& farm) {
  while (!fs::exists(farm.root + "/notify.json")) ::poll(nullptr, 0, 5);
}

TEST(Notify, APrintBeyondItsBandIsTold) {
  Farm farm;
  const JobId id = farm.submit({farm.job("hook")}).at(0);
  ReadModel model(farm.folder.database(), farm.clock);
  const std::int64_t before = model.summary().last_event;
  farm.queue.add_event("scan_kept", "scan 9", id);
  farm.queue.add_event("scan_beyond", "scan 9 lies beyond its band", id);
  const Notices told = notices_since(model, "farm", before);
  ASSERT_EQ(told.list.size(), 1U);
  const json message = json::parse(told.list[0].json);
  EXPECT_EQ(message["kind"], "scan_beyond");
  EXPECT_EQ(message["job"], id);
  EXPECT_EQ(message["name"], "hook");
  EXPECT_THAT(message["text"].get<std::string>(), HasSubstr("beyond its band"));
}

TEST(Notify, WhatIsTold) {
  Farm farm;
  Receiver receiver;
  test::write_file(
      farm.root + "/notify.toml",
      fmt::format("[[webhook]]\nurl = \"{}\"\nheaders = [\"X-Key: secret\"]\n", receiver.url()));
  farm.set("max-attempts", "1");
  // History: ended before, told to nobody.
  farm.submit({farm.job("old")});
  farm.finish(farm.claim(), 1, test::figures_with(1));
  const Notifier notifier(farm.folder, quick());
  wait_until_looking(farm);
  const auto ids = farm.submit({farm.job("one"), farm.job("two")});
  farm.give_up(farm.claim(), 1, Reason::bad_input, "no triangles");
  ASSERT_TRUE(receiver.wait([&] { return receiver.messages.size() == 1; }));
  EXPECT_EQ(receiver.messages[0]["kind"], "job_failed");
  EXPECT_EQ(receiver.messages[0]["job"], ids[0]);
  EXPECT_EQ(receiver.messages[0]["reason"], "bad_input");
  EXPECT_THAT(receiver.messages[0]["text"].get<std::string>(), HasSubstr("no triangles"));
  EXPECT_EQ(receiver.headers.find("X-Key")->second, "secret");
  EXPECT_EQ(receiver.headers.find("Idempotency-Key")->second, receiver.messages[0]["id"]);
  farm.finish(farm.claim(), 1, test::figures_with(1));
  farm.queue.add_event("disk_low", "300 MB are free, 1024 are wanted");
  ASSERT_TRUE(receiver.wait([&] { return receiver.messages.size() == 4; }));
  EXPECT_EQ(receiver.kinds(),
            (std::vector<std::string>{"batch_done", "disk_low", "job_failed", "queue_empty"}));
  for (const json& m : receiver.messages) {
    if (m["kind"] == "batch_done") {
      EXPECT_EQ(m["done"], 1);
      EXPECT_EQ(m["failed"], 1);
    }
  }
  std::set<std::string> different;
  for (const json& m : receiver.messages) different.insert(m["id"].get<std::string>());
  EXPECT_EQ(different.size(), 4U);
  // And in the record, without the header's secret.
  const auto told = [&] {
    int n = 0;
    for (const FarmEvent& e : farm.model().events(0, 1000)) {
      n += e.kind == "notified";
      EXPECT_EQ(e.text.find("secret"), std::string::npos);
    }
    return n;
  };
  while (told() < 4) ::poll(nullptr, 0, 5);
}

TEST(Notify, AgainUntilItIsTakenAlsoAfterARestart) {
  Farm farm;
  farm.set("max-attempts", "1");
  Receiver receiver;
  receiver.refuse = 3;
  test::write_file(
      farm.root + "/notify.toml",
      fmt::format("[[webhook]]\nurl = \"{}\"\non = [\"job_failed\"]\n", receiver.url()));
  {
    const Notifier notifier(farm.folder, quick());
    wait_until_looking(farm);
    farm.submit({farm.job("one")});
    farm.give_up(farm.claim(), 1, Reason::hung, "no progress");
    ASSERT_TRUE(receiver.wait([&] { return receiver.messages.size() == 1; }));
  }
  EXPECT_EQ(receiver.refused, 3);
  {
    // Refused for as long as this one lives: the next one sends the same message, by the same id.
    NotifyOptions slow = quick();
    slow.first_delay_s = 3600;
    receiver.refuse = 1;
    const Notifier notifier(farm.folder, slow);
    farm.submit({farm.job("two")});
    farm.give_up(farm.claim(), 1, Reason::hung, "no progress");
    ASSERT_TRUE(receiver.wait([&] { return receiver.refused == 4; }));
  }
  const Notifier notifier(farm.folder, quick());
  ASSERT_TRUE(receiver.wait([&] { return receiver.messages.back()["name"] == "two"; }));
  // A message whose answer the end of its notifier cut off comes again, by its id.
  std::set<std::string> ids;
  for (const json& m : receiver.messages) ids.insert(m["id"].get<std::string>());
  EXPECT_EQ(ids.size(), 2U);
}

TEST(Notify, OneProcessSends) {
  Farm farm;
  farm.set("max-attempts", "1");
  Receiver receiver;
  test::write_file(
      farm.root + "/notify.toml",
      fmt::format("[[webhook]]\nurl = \"{}\"\non = [\"job_failed\"]\n", receiver.url()));
  auto first = std::make_unique<Notifier>(farm.folder, quick());
  wait_until_looking(farm);
  while (!first->sends()) ::poll(nullptr, 0, 5);
  const Notifier second(farm.folder, quick());
  farm.submit({farm.job("one"), farm.job("two")});
  farm.give_up(farm.claim(), 1, Reason::hung, "no progress");
  ASSERT_TRUE(receiver.wait([&] { return receiver.messages.size() == 1; }));
  EXPECT_FALSE(second.sends());
  first.reset();
  farm.give_up(farm.claim(), 1, Reason::hung, "no progress");
  ASSERT_TRUE(receiver.wait([&] { return receiver.messages.size() == 2; }));
  EXPECT_TRUE(second.sends());
}

TEST(Notify, ManyFailuresAreOneMessage) {
  Farm farm;
  farm.set("max-attempts", "1");
  std::vector<NewJob> jobs;
  for (int i = 0; i < 30; ++i) jobs.push_back(farm.job(fmt::format("part-{}", i)));
  farm.submit(jobs);
  for (int i = 0; i < 30; ++i) farm.give_up(farm.claim(), 1, Reason::bad_input, "bad");
  auto model = farm.model();
  const Notices found = notices_since(model, "f", 0);
  ASSERT_EQ(found.list.size(), 3U);
  EXPECT_EQ(json::parse(found.list[0].json)["jobs_failed"], 30);
  EXPECT_EQ(found.list[1].kind, "batch_done");
  EXPECT_EQ(found.list[2].kind, "queue_empty");
  EXPECT_EQ(found.seen, model.summary().last_event);
  // The same look gives the same ids.
  const Notices again = notices_since(model, "f", 0);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found.list[i].id, again.list[i].id);
}

TEST(Notify, ABatchTellsWhatItsPrintsComeTo) {
  Farm farm;
  farm.submit({farm.job("plain"), farm.job("loose"), farm.job("narrow")});
  const std::pair<const char*, const char*> verdicts[] = {
      {"as-designed", "Prints as designed."}, {"fails", "Will not hold."}, {"look", "Look at it."}};
  for (const auto& [outcome, words] : verdicts) {
    ResultFigures figures;
    figures.layers = 10;
    figures.verdict = ResultVerdict{outcome, words};
    farm.finish(farm.claim(), 1, figures);
  }
  auto model = farm.model();
  const Notices found = notices_since(model, "f", 0);
  ASSERT_EQ(found.list.at(0).kind, "batch_done");
  const json told = json::parse(found.list[0].json);
  EXPECT_EQ(told["look"], 1);
  EXPECT_EQ(told["fails"], 1);
  // The gravest in its own words.
  EXPECT_THAT(told["text"].get<std::string>(), HasSubstr("1 to look at before printing, 1 that"));
  EXPECT_THAT(told["text"].get<std::string>(), HasSubstr("Will not hold."));
  EXPECT_EQ(told["text"].get<std::string>().find("Look at it."), std::string::npos);
}

TEST(Notify, CommandsGetJsonAndVariables) {
  Farm farm;
  farm.set("max-attempts", "1");
  const std::string out = farm.root + "/told";
  const std::string script = farm.root + "/tell";
  test::write_file(script,
                   "#!/bin/sh\ncat > \"$1.json\"\nenv | grep '^FARM_' > \"$1.env.part\"\n"
                   "mv \"$1.env.part\" \"$1.env\"\necho noise; exit 0\n");
  fs::permissions(script, fs::perms::owner_all);
  // No shell: what stands in arguments is not looked into.
  const std::string argument = out + "; touch pwned $(id)";
  test::write_file(farm.root + "/notify.toml",
                   fmt::format("[[command]]\nrun = [\"{}\", \"{}\"]\non = [\"job_failed\"]\n",
                               script, argument));
  const Notifier notifier(farm.folder, quick());
  wait_until_looking(farm);
  const auto id = farm.submit({farm.job("$(touch pwned)")})[0];
  farm.give_up(farm.claim(), 1, Reason::infeasible, "too fast\nby half");
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!fs::exists(argument + ".env") && std::chrono::steady_clock::now() < end) {
    ::poll(nullptr, 0, 5);
  }
  std::ifstream variables(argument + ".env");
  const std::string text(std::istreambuf_iterator<char>(variables), {});
  EXPECT_THAT(text, HasSubstr("FARM_KIND=job_failed\n"));
  EXPECT_THAT(text, HasSubstr(fmt::format("FARM_JOB={}\n", id)));
  EXPECT_THAT(text, HasSubstr("FARM_REASON=infeasible\n"));
  EXPECT_THAT(text, HasSubstr("FARM_NAME=$(touch pwned)\n"));
  std::ifstream message(argument + ".json");
  EXPECT_EQ(json::parse(message)["message"], "too fast\nby half");
  EXPECT_FALSE(fs::exists("pwned"));
}

TEST(Notify, CommandsThatHangOrFailAreEnded) {
  Farm farm;
  NotifyTarget target;
  target.name = "command";
  target.timeout_s = 0.2;
  Notice notice;
  notice.json = std::string(1 << 20, ' ');
  const int never[2] = {::open("/dev/null", O_RDONLY | O_CLOEXEC), -1};
  // A pipe that never becomes readable.
  int pipe[2];
  ASSERT_EQ(::pipe2(pipe, O_CLOEXEC), 0);
  target.command = {"/bin/sh", "-c", "sleep 3600 & sleep 3600"};
  EXPECT_THAT(deliver(target, notice, pipe[0]), HasSubstr("took longer than 0.2 s"));
  target.timeout_s = 60;
  target.command = {"/bin/sh", "-c", "exit 7"};
  EXPECT_EQ(deliver(target, notice, pipe[0]), "exit code 7");
  target.command = {"/nowhere/at/all"};
  EXPECT_THAT(deliver(target, notice, pipe[0]), HasSubstr("can't be started"));
  target.command = {"/bin/sh", "-c", "kill -9 $$"};
  EXPECT_EQ(deliver(target, notice, pipe[0]), "ended by signal 9");
  target.command = {"/bin/true"};
  EXPECT_EQ(deliver(target, notice, pipe[0]), "");
  // Who stops does not wait.
  ASSERT_EQ(::write(pipe[1], "x", 1), 1);
  target.command = {"/bin/sleep", "3600"};
  EXPECT_THAT(deliver(target, notice, pipe[0]), HasSubstr("stops"));
  for (const int fd : {pipe[0], pipe[1], never[0]}) ::close(fd);
}

TEST(Notify, OverTls) {
  if (!fs::exists("/usr/bin/openssl")) GTEST_SKIP() << "openssl is not installed";
  Farm farm;
  const std::string key = farm.root + "/key.pem", certificate = farm.root + "/cert.pem";
  ASSERT_EQ(run_program({"/usr/bin/openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes",
                         "-days", "2", "-subj", "/CN=127.0.0.1", "-addext",
                         "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate})
                .exit_code,
            0);
  httplib::SSLServer server(certificate.c_str(), key.c_str());
  ASSERT_TRUE(server.is_valid());
  std::atomic<int> taken{0};
  server.Post("/hook", [&](const httplib::Request&, httplib::Response& r) {
    ++taken;
    r.status = 200;
  });
  const int port = server.bind_to_any_port("127.0.0.1");
  std::thread thread([&] { server.listen_after_bind(); });
  int pipe[2];
  ASSERT_EQ(::pipe2(pipe, O_CLOEXEC), 0);
  NotifyTarget target;
  target.url = fmt::format("https://127.0.0.1:{}/hook", port);
  Notice notice;
  notice.json = "{}";
  // Nobody who is trusted has signed it.
  EXPECT_NE(deliver(target, notice, pipe[0]), "");
  EXPECT_EQ(taken, 0);
  target.ca_file = certificate;
  EXPECT_EQ(deliver(target, notice, pipe[0]), "");
  EXPECT_EQ(taken, 1);
  server.stop();
  thread.join();
  ::close(pipe[0]);
  ::close(pipe[1]);
}

TEST(Notify, FilesThatAreWrong) {
  Farm farm;
  const std::string path = farm.root + "/notify.toml";
  EXPECT_TRUE(read_notify_file(path).empty());
  for (const char* bad :
       {"nonsense", "[[webhook]]\n", "[[webhook]]\nurl = 7\n", "[[webhook]]\nurl = \"ftp://x\"\n",
        "[[webhook]]\nurl = \"http://x\"\non = [\"sunrise\"]\n", "[[command]]\nrun = []\n",
        "[[command]]\nrun = [\"relative\"]\n", "[[command]]\nrun = \"/bin/sh -c x\"\n",
        "[[pigeon]]\nname = \"x\"\n", "webhook = 7\n",
        "[[webhook]]\nurl = \"http://x\"\ntimeout_s = 0\n",
        "[[webhook]]\nurl = \"http://x\"\nheaders = [\"no colon\"]\n",
        "[[webhook]]\nurl = \"http://x\"\nheaders = [\"A: b\\r\\nC: d\"]\n",
        "[[webhook]]\nurl = \"http://x\"\nmost_tries = 0\n"}) {
    test::write_file(path, bad);
    try {
      read_notify_file(path);
      ADD_FAILURE() << bad;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("line ")) << bad;
    }
  }
  test::write_file(path,
                   "[[webhook]]\nurl = \"https://me:pw@x.example/hook?key=1\"\n"
                   "[[webhook]]\nurl = \"https://me:pw@x.example/hook?key=2\"\n");
  const auto targets = read_notify_file(path);
  ASSERT_EQ(targets.size(), 2U);
  EXPECT_EQ(targets[0].name, "webhook https://x.example/hook");
  EXPECT_EQ(targets[1].name, "webhook https://x.example/hook (2)");
}

TEST(Notify, TestOfTheProgram) {
  Farm farm;
  auto result = run_program({kSlicefarm, "notify", "--test", "--dir", farm.root});
  EXPECT_EQ(result.exit_code, 2);
  Receiver receiver;
  test::write_file(farm.root + "/notify.toml",
                   fmt::format("[[webhook]]\nurl = \"{}\"\n[[command]]\nrun = [\"/bin/false\"]\n",
                               receiver.url()));
  result = run_program({kSlicefarm, "notify", "--test", "--dir", farm.root});
  EXPECT_EQ(result.exit_code, 4);
  EXPECT_THAT(result.err, HasSubstr("taken"));
  EXPECT_THAT(result.err, HasSubstr("command /bin/false: exit code 1"));
  EXPECT_TRUE(receiver.wait([&] { return receiver.messages.size() == 1; }));
}

}  // namespace
}  // namespace slicecorr::farm
