// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm as a printer: requests as PrusaSlicer's source makes them, by the library that it makes
// them with (curl); on to a machine in another language.

#include <thread>

#include "farm_machine_room.hpp"
#include "farm_program.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/as_printer.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

const std::string kCurl = "/usr/bin/curl";
const std::string kKey = "farm-key-1";

struct Answer {
  int status = 0;
  json body;
};

/// A farm with a machine of the peer, served as a printer.
class AsPrinter : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
    if (!fs::exists(kCurl)) GTEST_SKIP() << "curl is not installed";
    made = std::make_unique<MachineRoomOfTest>(peer_kinds()[1]);
    made->spec.name = "sl1";
    made->spec.printer = "dual-wavelength-dlp";
    made->spec.format = "sl1";
    add_machine(made->folder, made->spec);
    const std::string file = made->folder.root + "/machines.toml";
    write_file(file,
               text_of_file(file) + "[machine.job]\nresin = \"benchy-resin\"\nspeed_mm_h = 800\n");
    serve();
  }
  void serve(std::int64_t most_bytes = 64 << 20) {
    stop();
    AsPrinterOptions options;
    options.key = kKey;
    options.machine = "sl1";
    options.most_upload_bytes = most_bytes;
    options.times = quick_times();
    options.submit = make_submitter({made->folder, {}, "anna"});
    server = std::make_unique<PrinterServer>(made->folder, options);
    thread = std::thread([this] { server->run(); });
    // Who stops it must not come before it begins.
    EXPECT_TRUE(eventually([&] { return curl({}, "/").status == 401; }));
  }
  void stop() {
    if (server) server->stop();
    if (thread.joinable()) thread.join();
    server.reset();
  }
  void TearDown() override { stop(); }

  Answer curl(const Command& arguments, const std::string& path) const {
    const RunResult r = run_program(Command{kCurl, "-sS", "-w", "\n%{http_code}"} + arguments +
                                    Command{server->address() + path});
    const std::size_t line = r.out.rfind('\n');
    Answer answer;
    answer.status = line == r.out.npos ? 0 : std::atoi(r.out.c_str() + line + 1);
    answer.body = json::parse(r.out.substr(0, line), nullptr, false);
    return answer;
  }
  static Command with_key() { return {"-H", "X-Api-Key: " + kKey}; }
  /// As PrusaSlicer sends a file.
  Answer upload(const Command& login, const std::string& file, const std::string& name,
                const std::string& print = "false") const {
    return curl(login + Command{"-H", "Expect:", "-F", "print=" + print, "-F", "path=", "-F",
                                "file=@" + file + ";filename=\"" + name + "\""},
                "/api/files/local");
  }
  std::vector<Job> jobs() const { return ReadModel(made->folder.database()).jobs({}); }
  std::string slices(unsigned seed = 1) { return made->file(seed, 1280, 800); }

  std::unique_ptr<MachineRoomOfTest> made;
  std::unique_ptr<PrinterServer> server;
  std::thread thread;
};

TEST_F(AsPrinter, WhatASlicerSendsIsCorrectedAndPrinted) {
  // First the test of its window, then the file; by digest as an SL1 wants it.
  const Command digest{"--digest", "-u", "maker:" + kKey};
  const Answer version = curl(digest, "/api/version");
  EXPECT_EQ(version.status, 200);
  EXPECT_TRUE(version.body.value("text", "").starts_with("Prusa SLA")) << version.body;
  EXPECT_TRUE(version.body.contains("api"));
  const Answer taken = upload(digest, slices(), "Größe 1.sl1");
  ASSERT_EQ(taken.status, 201) << taken.body;
  EXPECT_EQ(taken.body["effectivePrint"], false);
  ASSERT_EQ(jobs().size(), 1);
  EXPECT_THAT(jobs()[0].labels, ElementsAre("for sl1"));
  EXPECT_EQ(jobs()[0].printer, "dual-wavelength-dlp");
  EXPECT_EQ(jobs()[0].resin, "benchy-resin");
  EXPECT_EQ(jobs()[0].user, "anna");
  const RunResult run = run_program(
      {kSlicefarm, "run", "--until-empty", "--dir", made->folder.root, "--threads", "1"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Job done = jobs()[0];
  EXPECT_EQ(StackReader::read_info(stack_of(done)).kind, StackKind::corrected);
  EXPECT_EQ(StackReader::read_info(stack_of(done)).format, "sl1");
  const RunResult sent = run_program(
      {kSlicefarm, "machines", "send", std::to_string(done.id), "sl1", "--dir", made->folder.root});
  EXPECT_EQ(sent.exit_code, 0) << sent.err;
  EXPECT_EQ(made->peer.begun(), 0);
  MachineRoom room = made->room();
  room.start(kBothWords);
  EXPECT_EQ(made->peer.begun(), 1);
  // The slicer is told how the machine does.
  EXPECT_TRUE(eventually(
      [&] { return curl(with_key(), "/api/printer").body["state"]["flags"]["printing"] == true; }));
  const Answer job = curl(with_key(), "/api/job");
  EXPECT_TRUE(job.body["progress"]["printTimeLeft"].is_number()) << job.body;
  EXPECT_EQ(curl(with_key(), "/api/files").body["files"][0]["state"], "done");
  EXPECT_EQ(curl(with_key() + Command{"-d", R"({"command":"cancel"})"}, "/api/job").status, 204);
  EXPECT_EQ(made->peer.happened("ended").size(), 1);
}

TEST_F(AsPrinter, StartsNothingByItself) {
  const Answer refused = upload(with_key(), slices(), "a.sl1", "true");
  EXPECT_EQ(refused.status, 409);
  EXPECT_THAT(refused.body.value("message", ""), HasSubstr("starts nothing"));
  EXPECT_TRUE(jobs().empty());
  EXPECT_EQ(curl(with_key() + Command{"-d", R"({"command":"select","print":true})"},
                 "/api/files/local/a.sl1")
                .status,
            409);
  EXPECT_EQ(curl(with_key() + Command{"-d", R"({"command":"start"})"}, "/api/job").status, 409);
  EXPECT_EQ(made->peer.begun(), 0);
}

TEST_F(AsPrinter, NothingIsToldOrTakenWithoutTheKey) {
  const std::string file = slices();
  EXPECT_EQ(curl({}, "/api/version").status, 401);
  EXPECT_EQ(curl({"-H", "X-Api-Key: farm-key-2"}, "/api/version").status, 403);
  EXPECT_EQ(curl({"-H", "X-Api-Key:"}, "/api/version").status, 401);
  EXPECT_EQ(curl({"--digest", "-u", "maker:farm-key-2"}, "/api/version").status, 401);
  EXPECT_EQ(curl({"--digest", "-u", "root:" + kKey}, "/api/version").status, 401);
  EXPECT_EQ(upload({}, file, "a.sl1").status, 401);
  EXPECT_EQ(curl({"-H", "Authorization: Bearer " + kKey}, "/api/version").status, 200);
  // A page of another site in the same browser; a name that was pointed here.
  EXPECT_EQ(curl(with_key() + Command{"-H", "Origin: http://evil.example"}, "/api/version").status,
            403);
  EXPECT_EQ(curl(with_key() + Command{"-H", "Host: evil.example"}, "/api/version").status, 403);
  for (int i = 0; i < 40; ++i) {
    if (curl({"-H", "X-Api-Key: wrong"}, "/api/version").status == 429) break;
  }
  EXPECT_EQ(curl(with_key(), "/api/version").status, 429) << "keys may be tried without end";
  EXPECT_TRUE(jobs().empty());
}

TEST_F(AsPrinter, WhatDoesNotFitIsRefusedWithItsReason) {
  const std::string file = slices();
  const Answer wrong = upload(with_key(), made->file(2, 100, 100), "a.sl1");
  EXPECT_EQ(wrong.status, 409);
  EXPECT_THAT(wrong.body.value("message", ""), HasSubstr("nothing was queued")) << wrong.body;
  write_file(made->path("x"), std::string("no archive"));
  EXPECT_EQ(upload(with_key(), made->path("x"), "x.sl1").status, 409);
  write_file(made->path("empty"), std::string());
  EXPECT_EQ(upload(with_key(), made->path("empty"), "x.sl1").status, 400);
  for (const char* name : {".hidden.sl1", "-x.sl1", "..", "a/"}) {
    EXPECT_EQ(upload(with_key(), file, name).status, 400) << name;
  }
  EXPECT_EQ(curl(with_key() + Command{"-F", "print=false"}, "/api/files/local").status, 400);
  EXPECT_EQ(curl(with_key() + Command{"-d", "x"}, "/api/files/local").status, 415);
  EXPECT_EQ(
      curl(with_key() + Command{"-F", "path=" + std::string(5000, 'x'), "-F", "file=@" + file},
           "/api/files/local")
          .status,
      400);
  EXPECT_EQ(curl(with_key(), "/etc/passwd").status, 404);
  EXPECT_TRUE(jobs().empty());
  serve(1000);
  EXPECT_EQ(upload(with_key(), file, "a.sl1").status, 413);
  EXPECT_TRUE(jobs().empty());
}

TEST_F(AsPrinter, ARuleIsCheckedBeforeAnythingIsServed) {
  const std::string file = made->folder.root + "/machines.toml";
  const std::string text = text_of_file(file);
  write_file(file, text + "colour = \"red\"\n");
  EXPECT_THAT(refusal([&] { serve(); }), HasSubstr("colour"));
  write_file(file, text + "part = \"x\"\n");
  EXPECT_THAT(refusal([&] { serve(); }), HasSubstr("no place in a rule"));
  write_file(file, text);
}

TEST(JobsForMachines, SayPrinterAndFormat) {
  const FarmFolderOfTest made;
  const FarmFolder folder = open_folder(made.path());
  write_file(folder.root + "/machines.toml",
             "[[machine]]\nname = \"saturn-1\"\nkind = \"sdcp3\"\naddress = \"127.0.0.1\"\n"
             "printer = \"dual-wavelength-dlp\"\nformat = \"goo\"\n");
  write_file(made / "a.stl", bridge_stl(1));
  Queue queue(folder.database());
  const auto prepared = [&](const std::string& more) {
    const std::string text =
        "[[job]]\npart = \"" + (made / "a.stl") +
        "\"\nresin = \"benchy-resin\"\nlayer_um = 50\nmode = \"continuous\"\nspeed_mm_h = 800\n" +
        more;
    return prepare(parse_jobs_toml(text, "jobs.toml"), folder, queue, "anna", false, {});
  };
  const Submission s = prepared("for = \"saturn-1\"\n");
  ASSERT_EQ(s.jobs.size(), 1);
  EXPECT_THAT(s.jobs[0].labels, ElementsAre("for saturn-1"));
  EXPECT_EQ(s.jobs[0].work.format, "goo");
  EXPECT_THAT(refusal([&] { prepared("for = \"nobody\"\n"); }), HasSubstr("no machine 'nobody'"));
  EXPECT_THAT(refusal([&] { prepared("for = \"saturn-1\"\nformat = \"sl1\"\n"); }),
              HasSubstr("does not read"));
  EXPECT_THAT(refusal([&] { prepared("for = \"saturn-1\"\nprinter = \"prusa-sl1s\"\n"); }),
              HasSubstr("is a dual-wavelength-dlp"));
}

}  // namespace
}  // namespace slicecorr::farm
