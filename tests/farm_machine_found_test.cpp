// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printers that announce themselves, against a responder in another language, on 127.0.0.1 alone; and
// pictures of what is on machines.

#include <png.h>

#include "farm_machine_room.hpp"
#include "farm_program.hpp"
#include "machines/mdns.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack_preview.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::StartsWith;

class Announced : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};

TEST_F(Announced, PrusaLinkAndOctoPrintAreFoundByTheQuestionToEverybody) {
  for (const auto& [kind, told] :
       {std::pair("prusalink", "prusalink"), {"octoprint", "octoprint"}}) {
    MachinePeer peer(kind, {"announce"});
    const RunResult r =
        run_program({kSlicefarm, "machines", "discover", "--own-address", "127.0.0.1",
                     "224.0.0.251:" + std::to_string(peer.mdns), "--json", "-"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const json list = json::parse(r.out);
    ASSERT_EQ(list.size(), 1) << r.out;
    EXPECT_EQ(list[0]["kind"], told);
    EXPECT_THAT(list[0]["name"], StartsWith("Größe. "));
    // Where the answer came from, not the address that the machine believes to have.
    EXPECT_EQ(list[0]["address"], "127.0.0.1:" + std::to_string(peer.port));
    const auto asked = peer.happened("mdns");
    ASSERT_FALSE(asked.empty());
    EXPECT_EQ(asked[0]["everybody"], true);
    // What RFC 1035 and 6763 say a question for a service is: one of type 12 (PTR), class 1.
    EXPECT_EQ(asked[0]["hex"],
              "0000"
              "0000"
              "0001"
              "0000"
              "0000"
              "0000"
              "0a5f6f63746f7072696e74"
              "045f746370"
              "056c6f63616c"
              "00"
              "000c"
              "0001");
  }
}

TEST_F(Announced, OneHostIsAskedAloneAndWhatItLeavesOutOnceMore) {
  MachinePeer peer("prusalink-v1", {"announce", "bare"});
  const auto found = discover_machines({"127.0.0.1:" + std::to_string(peer.mdns)}, 2);
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(found[0].kind, MachineKind::prusalink);
  EXPECT_EQ(found[0].model, "SL1S");
  EXPECT_EQ(found[0].firmware, "1.8");
  EXPECT_EQ(found[0].host, "127.0.0.1:" + std::to_string(peer.port));
  // The address is one that `machines add` takes.
  MachineSpec spec;
  set_address(spec, found[0].host);
  EXPECT_EQ(spec.port, peer.port);
}

TEST_F(Announced, DamagedAnswersAndWrongAddressesAreNone) {
  MachinePeer peer("octoprint", {"announce", "damaged"});
  EXPECT_TRUE(discover_machines({"127.0.0.1:" + std::to_string(peer.mdns)}, 0.3).empty());
  EXPECT_THROW(discover_machines({}, 0.1, "10.254.253.252"), InputError);
  EXPECT_THROW(discover_machines({}, 0.1, "here"), InputError);
}

/// A PTR of the service, then an SRV whose owner points at the PTR's name, at byte 0x28.
std::string small_answer() {
  const std::string service("\x0a_octoprint\x04_tcp\x05local\0", 23);
  const std::string head("\0\0\x84\0\0\0\0\2\0\0\0\0", 12);
  const std::string ptr = service + std::string("\0\x0c\0\1\0\0\0\x0a\0\x06", 10) +
                          std::string(
                              "\x03"
                              "a\tb"
                              "\xc0\x0c",
                              6);
  const std::string srv("\xc0\x2d\0\x21\x80\1\0\0\0\x0a\0\x09\0\0\0\0\x13\x88\1h\0", 21);
  return head + ptr + srv;
}

TEST(Mdns, AnswersAreReadWithinBounds) {
  const std::string good = small_answer();
  const detail::MdnsAnswer answer = detail::mdns_answer(good, "192.0.2.7");
  ASSERT_EQ(answer.found.size(), 1);
  EXPECT_EQ(answer.found[0].host, "192.0.2.7:5000");
  EXPECT_EQ(answer.found[0].name.find('\t'), std::string::npos) << "what reaches a terminal";
  EXPECT_EQ(answer.found[0].kind, MachineKind::octoprint);
  // A question is no answer.
  std::string question = good;
  question[2] = 0;
  EXPECT_TRUE(detail::mdns_answer(question, "h").found.empty());
  // Whatever is cut off or changed is read without harm, and never tells of a host that did not send.
  for (std::size_t cut = 0; cut < good.size(); ++cut) {
    EXPECT_TRUE(detail::mdns_answer(good.substr(0, cut), "h").found.empty()) << cut;
  }
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (const int value : {0, 1, 0x3f, 0x7f, 0xc0, 0xff}) {
      std::string changed = good;
      changed[at] = static_cast<char>(value);
      for (const FoundMachine& f : detail::mdns_answer(changed, "192.0.2.7").found) {
        EXPECT_THAT(f.host, StartsWith("192.0.2.7"));
      }
    }
  }
  EXPECT_TRUE(detail::mdns_answer(std::string(100'000, '\xff'), "h").found.empty());
}

// --- pictures -------------------------------------------------------------------------------------

class Pictures : public testing::TestWithParam<PeerKind> {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};

TEST_P(Pictures, AreOfTheFileThatWasSentAndOfOtherPeoplesPrints) {
  MachineRoomOfTest made(GetParam());
  MachineRoom room = made.room();
  EXPECT_EQ(room.picture(room.look()), "");
  const std::string with = made.path("seen." + GetParam().ending);
  const Images images = random_images(192, 108, 5, 1);
  StackInfo info = info_of(images.grid);
  info.exposure_s = 2;
  GreyImage preview{40, 20, std::vector<std::uint8_t>(800, 200)};
  write_stack(with, images, info, {}, preview);
  room.send(with);
  const std::string ours = room.picture(room.look());
  const std::vector<std::uint8_t> in_file = preview_png(with);
  EXPECT_TRUE(is_preview_png(in_file));
  EXPECT_EQ(ours, std::string(in_file.begin(), in_file.end()));
  room.start(kBothWords);
  EXPECT_EQ(room.picture(room.look()), ours);
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(room.look().status.state); }));
  // Somebody prints another file at the machine: its own picture, where its protocol has one.
  made.peer.tell("print other" + std::string(".") + GetParam().ending);
  EXPECT_TRUE(eventually([&] { return is_print(room.look().status.state); }));
  const std::string theirs = room.picture(room.look());
  EXPECT_NE(theirs, ours);
  // Neither SDCP's status nor NanoDLP's names a picture.
  const MachineKind kind = GetParam().kind;
  EXPECT_EQ(theirs.empty(), kind == MachineKind::sdcp3 || kind == MachineKind::nanodlp);
}

INSTANTIATE_TEST_SUITE_P(All, Pictures, testing::ValuesIn(peer_kinds()), [](const auto& info) {
  std::string name = info.param.peer;
  std::erase(name, '-');
  return name;
});

/// By libpng.
GreyImage decoded_png(const std::vector<std::uint8_t>& bytes) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  GreyImage image;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) return image;
  png.format = PNG_FORMAT_GRAY;
  image.width_px = static_cast<int>(png.width);
  image.height_px = static_cast<int>(png.height);
  image.pixels.resize(PNG_IMAGE_SIZE(png));
  png_image_finish_read(&png, nullptr, image.pixels.data(), 0, nullptr);
  return image;
}

TEST(StackPreview, IsThatOfTheFileInAllFormatsThatHoldOne) {
  const FarmFolderOfTest made;
  const Images images = random_images(192, 108, 3, 1);
  StackInfo info = info_of(images.grid);
  info.exposure_s = 2;
  // Left half dark, right half light.
  GreyImage preview{80, 80, std::vector<std::uint8_t>(6400)};
  for (std::size_t i = 0; i < preview.pixels.size(); ++i)
    preview.pixels[i] = i % 80 < 40 ? 40 : 200;
  for (const char* ending : {"sl1", "nanodlp", "uvj", "goo", "ctb"}) {
    SCOPED_TRACE(ending);
    const std::string path = made / (std::string("a.") + ending);
    write_stack(path, images, info, {}, preview);
    const std::vector<std::uint8_t> png = preview_png(path);
    ASSERT_TRUE(is_preview_png(png));
    const GreyImage seen = decoded_png(png);
    const auto grey = [&](double x) {
      const int column = static_cast<int>(x * seen.width_px);
      return int{
          seen.pixels[static_cast<std::size_t>(seen.height_px / 2 * seen.width_px + column)]};
    };
    // GOO and CTB keep five bits of red and blue, six of green: 8 of 255 at most are lost.
    EXPECT_NEAR(grey(0.45), 40, 8);
    EXPECT_NEAR(grey(0.55), 200, 8);
  }
  write_file(made / "no.sl1", std::string("no zip"));
  EXPECT_THROW(preview_png(made / "no.sl1"), InputError);
}

}  // namespace
}  // namespace slicecorr::farm
