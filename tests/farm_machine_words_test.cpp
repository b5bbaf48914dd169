// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What machines say and are told, byte for byte, without a network.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "farm_fixture.hpp"
#include "machines/digest.hpp"
#include "machines/http_calls.hpp"
#include "machines/record.hpp"
#include "machines/sdcp.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using detail::sdcp_json;
using detail::sdcp_status;
using testing::ElementsAre;
using testing::HasSubstr;

MachineStatus status_of(const std::string& text, bool first = false) {
  return sdcp_status(sdcp_json(text), first);
}

TEST(MachineWords, APrintUnderWay) {
  const MachineStatus s = status_of(
      R"({"Status":{"CurrentStatus":[1],"TempOfUVLED":41.03,"PrintInfo":{"Status":3,"CurrentLayer":36,
      "TotalLayer":157,"CurrentTicks":672608,"TotalTicks":1714197,"Filename":"a.goo","TaskId":"t"}}})");
  EXPECT_EQ(s.state, MachineState::printing);
  EXPECT_EQ(s.phase, "exposing");
  EXPECT_NEAR(100.0 * *s.layer / *s.layers, 22.9, 0.05);
  EXPECT_NEAR(*s.run_s, 672.6, 0.05);
  EXPECT_NEAR(*s.left_s, 1041.6, 0.05);
  const MachineStatus later = status_of(
      R"({"Data":{"Status":{"CurrentStatus":[1],"PrintInfo":{"Status":4.0,"CurrentTicks":676127,"TotalTicks":1714197}}}})");
  EXPECT_EQ(later.phase, "lifting");
  EXPECT_NEAR(*later.left_s, 1038.07, 0.005);
}

TEST(MachineWords, LayersOfAnOldPrintAreNoPrint) {
  const MachineStatus s = status_of(
      R"({"Status":{"CurrentStatus":[0],"PrintInfo":{"Status":0,"CurrentLayer":283,"TotalLayer":283,
      "CurrentTicks":2757032,"TotalTicks":2757032,"TaskId":""}}})");
  EXPECT_EQ(s.state, MachineState::idle);
  EXPECT_FALSE(s.layer || s.layers || s.run_s || s.left_s);
  // 1790772080 to 1790774837 in its history: ticks are ms.
  EXPECT_NEAR(2757032 / 1000.0, 1790774837 - 1790772080, 1);
}

TEST(MachineWords, StatesOfAMachine) {
  const auto state = [](const std::string& current, const std::string& phase, bool first = false) {
    return status_of(
        R"({"Status":{"CurrentStatus":)" + current + R"(,"PrintInfo":{"Status":)" + phase + "}}}",
        first);
  };
  EXPECT_EQ(state("[2,8]", "0").state, MachineState::checking);
  EXPECT_FALSE(is_at_rest(state("[2,8]", "0").state));
  EXPECT_EQ(state("[2]", "0").state, MachineState::uploading);
  EXPECT_EQ(state("[1]", "6").state, MachineState::paused);
  EXPECT_EQ(state("[1]", "99").state, MachineState::printing);
  EXPECT_EQ(state("[1]", "99").phase, "other (99)");
  EXPECT_EQ(state("[1]", "16").phase, "preheating");
  EXPECT_EQ(state("1", "16", true).state, MachineState::finished);
  EXPECT_EQ(state("0", "16", true).state, MachineState::finished);
  EXPECT_EQ(state("[0]", "9").state, MachineState::finished);
  EXPECT_EQ(state("[77]", "0").state, MachineState::busy);
  // One bad field discards nothing else; no status at all is no idleness.
  EXPECT_EQ(state(R"([1,"x",null])", R"("six")").state, MachineState::printing);
  EXPECT_EQ(state("\"nonsense\"", "0").state, MachineState::unknown);
  EXPECT_EQ(status_of("[[[[").state, MachineState::unknown);
}

// Each number that the protocol names has words; others stay numbers, and nothing is no end.
TEST(MachineWords, HowAndWhyAPrintEnded) {
  const auto end = [](const std::string& entry) { return detail::sdcp_end(sdcp_json(entry)); };
  EXPECT_FALSE(end(R"({"TaskStatus":0})"));
  EXPECT_EQ(end(R"({"TaskStatus":1,"ErrorStatusReason":0})")->state, MachineState::finished);
  EXPECT_EQ(end(R"({"TaskStatus":3})")->why, "");
  const auto why = [&](int reason) {
    const auto said = end(R"({"TaskStatus":2,"ErrorStatusReason":)" + std::to_string(reason) + "}");
    return said && said->state == MachineState::failed ? said->why : "no failure";
  };
  EXPECT_EQ(why(0), "");
  EXPECT_EQ(why(1), "it got too hot");
  EXPECT_EQ(why(8), "the model came off");
  EXPECT_EQ(why(11), "its release film is worn out");
  EXPECT_EQ(why(14), "its Z axis did not find its home");
  EXPECT_EQ(why(18), "a model is on the platform");
  EXPECT_EQ(why(24), "the file is bad");
  EXPECT_EQ(why(34), "the vat's sensor has a fault");
  EXPECT_EQ(why(23), "reason 23");
  EXPECT_EQ(why(35), "reason 35");
  const auto error = [](const std::string& code) {
    return detail::sdcp_error(
        sdcp_json(R"({"Data":{"Data":{"ErrorCode":)" + code + R"(}},"Topic":"sdcp/error/1"})"));
  };
  EXPECT_THAT(error("1"), HasSubstr("checksum"));
  EXPECT_THAT(error("\"2\""), HasSubstr("format"));
  EXPECT_EQ(error("9"), "error 9");
  EXPECT_EQ(error("0"), "");
  EXPECT_EQ(detail::sdcp_error(sdcp_json(R"({"Topic":"sdcp/status/1"})")), "");
}

TEST(MachineWords, AnswersToAPart) {
  EXPECT_TRUE(
      detail::sdcp_part(200, R"({"code":"000000","messages":null,"data":{},"success":true})")
          .taken);
  const auto offset = detail::sdcp_part(
      200,
      R"({"code":"111111","messages":[{"field":"common_field","message":-2}],"data":null,"success":false})");
  EXPECT_FALSE(offset.taken);
  EXPECT_TRUE(offset.other_offset);
  const auto html = detail::sdcp_part(200, "<html></html>");
  EXPECT_FALSE(html.taken || html.other_offset);
}

TEST(MachineWords, ADigestIsAsTheStandardSays) {
  const detail::DigestChallenge challenge{"prusa-sl1", "dcd98b7102dd2f0e8b11d0f600bfb0c0", "", true,
                                          false};
  EXPECT_EQ(detail::md5_hex("maker:prusa-sl1:abcdefgh"), "6b3f75e3147ffa9dc64200cd76329512");
  EXPECT_EQ(detail::md5_hex("GET:/api/version"), "ef146612e40acbdeaf4559221ea9201c");
  EXPECT_EQ(detail::digest_response(challenge, {"maker", "abcdefgh"},
                                    {"GET", "/api/version", 1, "0a4f113b"}),
            "8eb65d4bdd936b725a58063db887aff8");
  const auto read = detail::read_challenge(
      R"(Digest realm="a, nonce=\"b\"", nonce="n", qop="auth-int, auth", stale=TRUE, opaque="o")");
  ASSERT_TRUE(read);
  EXPECT_EQ(read->realm, R"(a, nonce="b")");
  EXPECT_EQ(read->nonce, "n");
  EXPECT_TRUE(read->qop_auth && read->stale);
  EXPECT_FALSE(detail::read_challenge(R"(Basic realm="a")"));
  EXPECT_FALSE(detail::read_challenge(R"(Digest realm="a", nonce="n", algorithm=SHA-256)"));
}

TEST(MachineWords, NamesThatMachinesTake) {
  const std::string sha = "3f2a" + std::string(60, '0');
  EXPECT_EQ(sent_name("Größe 1.sl1", sha), "Gr__e_1-3f2a.sl1");
  EXPECT_EQ(sent_name("Größe 1.sl1", sha, 1), "Gr__e_1-3f2a-2.sl1");
  EXPECT_EQ(sent_name("../a%b:c'd.CTB", sha), "_._a_b_c_d-3f2a.ctb");
  EXPECT_EQ(sent_name("-x.goo", sha), "_x-3f2a.goo");
  EXPECT_EQ(sent_name(".goo", sha), "_goo-3f2a");
  const std::string name = sent_name(std::string(300, 'a') + ".nanodlp", sha, 8);
  EXPECT_EQ(name.size(), 64);
  EXPECT_TRUE(name.ends_with("-3f2a-9.nanodlp"));
  EXPECT_EQ(detail::path_segment("Größe 1.sl1"), "Gr%C3%B6%C3%9Fe%201.sl1");
}

TEST(MachineWords, WhoAnswersACall) {
  const auto third = detail::sdcp_found(
      R"({"Id":"x","Data":{"Name":"n","MachineName":"Saturn","MainboardIP":"1.2.3.4","MainboardID":"ab","ProtocolVersion":"V3.0.0"}})",
      "127.0.0.1");
  ASSERT_TRUE(third);
  EXPECT_EQ(third->kind, MachineKind::sdcp3);
  EXPECT_EQ(third->host, "127.0.0.1");
  const auto first = detail::sdcp_found(
      R"({"Id":"x","Data":{"Attributes":{"MainboardID":"ab","ProtocolVersion":"V1.0.0"},"Status":{}}})",
      "127.0.0.1");
  ASSERT_TRUE(first);
  EXPECT_EQ(first->kind, MachineKind::sdcp1);
  EXPECT_FALSE(detail::sdcp_found("M99999", "127.0.0.1"));
  EXPECT_FALSE(detail::sdcp_found(R"({"Data":{"MainboardID":7}})", "127.0.0.1"));
}

class MachinesFile : public testing::Test {
 protected:
  std::vector<MachineSpec> read(const std::string& text) {
    write_file(folder.root + "/machines.toml", text);
    return read_machines(folder);
  }
  FarmFolderOfTest made;
  FarmFolder folder{open_folder(made.path())};
};

TEST_F(MachinesFile, IsReadWrittenAndHasBridges) {
  EXPECT_TRUE(read_machines(folder).empty());
  write_file(folder.root + "/bridges.toml",
             "[[bridge]]\nname = \"left\"\nprinter = \"dlp\"\noptions = [\"--sink\"]\n");
  MachineSpec m;
  m.name = "saturn-1";
  m.host = "127.0.0.1";
  m.port = 3031;
  m.printer = "saturn";
  m.format = "goo";
  m.width_px = 192;
  m.height_px = 108;
  add_machine(folder, m);
  m.name = "sl1";
  m.kind = MachineKind::prusalink;
  m.login = "none";
  add_machine(folder, m);
  const std::vector<MachineSpec> all = read_machines(folder);
  ASSERT_EQ(all.size(), 3);
  EXPECT_EQ(all[0].name, "saturn-1");
  EXPECT_EQ(all[0].port, 3031);
  EXPECT_EQ(all[0].height_px, 108);
  EXPECT_EQ(all[1].kind, MachineKind::prusalink);
  EXPECT_EQ(all[2].kind, MachineKind::bridge);
  EXPECT_THAT(all[2].options, ElementsAre("--sink"));
  const std::string before = text_of_file(folder.root + "/machines.toml");
  EXPECT_THAT(refusal([&] { add_machine(folder, m); }), HasSubstr("called so"));
  m.name = "left";
  EXPECT_THAT(refusal([&] { add_machine(folder, m); }), HasSubstr("called so"));
  EXPECT_EQ(text_of_file(folder.root + "/machines.toml"), before);
}

TEST_F(MachinesFile, WhatIsWrongIsNamed) {
  const std::string good = "[[machine]]\nname = \"a\"\nkind = \"sdcp3\"\naddress = \"h\"\n";
  EXPECT_EQ(read(good).size(), 1);
  const std::pair<const char*, const char*> wrong[] = {
      {"kind = \"x\"", "sdcp3, sdcp1"},
      {"key = \"abcdefgh\"", "key_file"},
      {"colour = 1", "is no key of a machine"},
      {"resolution_px = [1]", "resolution_px"},
      {"resolution_px = 7", "machine.resolution_px: "},
      {"format = \".ctb\"", "without a point"},
      {"id = \"../x\"", "hex digits"},
      {"page = \"ftp://x\"", "http://"},
      {"options = [\"a\"]", "bridges only"}};
  for (const auto& [line, expected] : wrong) {
    std::string text = good + line + "\n";
    if (std::string(line).starts_with("kind")) {
      text = "[[machine]]\nname = \"a\"\naddress = \"h\"\n" + std::string(line) + "\n";
    }
    EXPECT_THAT(refusal([&] { read(text); }), HasSubstr(expected)) << line;
  }
  for (const char* address : {"", "http://h", "h:0", "h:99999", "h/x", "h:80x"}) {
    const std::string text =
        "[[machine]]\nname = \"a\"\nkind = \"sdcp3\"\naddress = \"" + std::string(address) + "\"\n";
    EXPECT_THAT(refusal([&] { read(text); }), HasSubstr("expected HOST")) << address;
  }
}

TEST(MachineRecords, AreFollowed) {
  const auto nothing = [](const std::string&) { return std::optional<PrintEnd>(); };
  const auto seen = [](MachineState state, const std::string& file) {
    MachineStatus s;
    s.state = state;
    s.file = file;
    s.layer = 5;
    s.layers = 5;
    return s;
  };
  MachineRecord asked;
  asked.print_state = "asked";
  asked.print_file = "a.goo";
  asked.plate_full = true;
  MachineRecord r = asked;
  detail::follow(r, {}, 1, nothing);  // no answer
  EXPECT_EQ(r.print_state, "asked");
  detail::follow(r, seen(MachineState::idle, ""), 1, nothing);
  EXPECT_EQ(r.print_state, "asked");
  detail::follow(r, seen(MachineState::printing, "/local/a.goo"), 1, nothing);
  EXPECT_EQ(r.print_state, "begun");
  MachineRecord stopped = r;
  detail::follow(r, seen(MachineState::idle, ""), 2, nothing);
  EXPECT_EQ(r.print_state, "finished");
  EXPECT_TRUE(r.plate_full);
  stopped.stop_asked = true;
  detail::follow(stopped, seen(MachineState::idle, ""), 2, nothing);
  EXPECT_EQ(stopped.print_state, "stopped");
  // Why, in the words of the machine, which whoever clears the plate reads.
  MachineRecord failed = asked;
  failed.print_state = "begun";
  detail::follow(failed, seen(MachineState::idle, ""), 2, [](const std::string&) {
    return std::optional(PrintEnd{MachineState::failed, "there is no resin"});
  });
  EXPECT_EQ(failed.print_state, "failed");
  EXPECT_EQ(failed.print_why, "there is no resin");
  EXPECT_EQ(failed.plate_why, "a print ended: failed (there is no resin)");
  // Somebody else's print: the plate is full, and our word is not taken for it.
  MachineRecord other;
  detail::follow(other, seen(MachineState::printing, "b.goo"), 3, nothing);
  EXPECT_TRUE(other.plate_full);
  r = asked;
  detail::follow(r, seen(MachineState::printing, "b.goo"), 3, nothing);
  EXPECT_EQ(r.print_state, "asked");
}

TEST(MachineRecords, ADamagedRecordIsNoEmptyPlate) {
  const FarmFolderOfTest folder;
  const std::string path = folder / "m.json";
  EXPECT_FALSE(detail::read_record(path).plate_full);
  MachineRecord r;
  r.plate_full = true;
  r.job = 7;
  detail::write_record(path, r);
  EXPECT_TRUE(detail::read_record(path).plate_full);
  EXPECT_EQ(detail::read_record(path).job, 7);
  for (const char* text : {"", "{", "[]", "{\"version\": 2}"}) {
    write_file(path, text);
    EXPECT_THROW(detail::read_record(path), DeviceError) << text;
  }
}

}  // namespace
}  // namespace slicecorr::farm
