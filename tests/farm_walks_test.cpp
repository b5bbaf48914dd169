// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Six walks through a lab's pages, each with a mouse, on a phone in portrait, with keys alone and by what a reader
// of screens has; at their ends axe finds nothing, where it is installed ($SLICECORR_AXE: axe.min.js).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "farm_browser.hpp"
#include "farm_scanned.hpp"
#include "hand.hpp"
#include "ladder.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using namespace test;
using ::testing::IsEmpty;

class Walk : public LabInABrowser, public ::testing::WithParamInterface<Way> {
 protected:
  void begin(const std::string& path, const std::string& token) {
    serve();
    hand_ = std::make_unique<Hand>(*page_, GetParam());
    open(path);
    hand_->press("#who button");
    hand_->type("#token", token);
    hand_->press("#ask button");
    page_->wait_for("document.body.dataset.ready === 'yes' && me.role !== 'look'");
  }
  std::string ladder() const {
    const std::string path = farm_.root + "/ladder.stl";
    slicecorr::test::write_stl(path, slicecorr::test::ladder());
    return path;
  }
  std::string block() const {
    const std::string path = farm_.root + "/block.stl";
    TriangleMesh box;
    slicecorr::test::add_box(box, {-1.5, -0.5, 0}, {1.5, 0.5, 1});
    slicecorr::test::write_stl(path, box);
    return path;
  }
  void take(const std::vector<std::string>& files) {
    page_->choose_files("#files", files);
    page_->wait_for(fmt::format("parts.there.length === {}", files.size()));
    hand_->choose("#printer", "dual-wavelength-dlp");
    hand_->choose("#resin", "benchy-resin");
  }
  void end(const std::string& where) {
    hand_->axe(where);
    EXPECT_THAT(page_->complaints(), IsEmpty());
  }

  std::unique_ptr<Hand> hand_;
};

TEST_P(Walk, APartToTheQueue) {
  begin("/print", kSubmit);
  take({ladder()});
  hand_->press("#look");
  see("plate");
  hand_->press("#plan");
  see("planned");
  hand_->hears("#plan-said");
  hand_->press("#use");
  hand_->press("#check");
  see("checked");
  hand_->press("#queue");
  page_->wait_for("document.getElementById('queue-said').textContent.includes('One job')");
  hand_->hears("#queue-said");
  EXPECT_EQ(farm_.model().jobs({})[0].user, "sam");
  end("print");
}

TEST_P(Walk, SeveralOnOnePlate) {
  begin("/print", kSubmit);
  take({ladder(), block()});
  hand_->press("input[name=how][value=plate]");
  hand_->type("#parts .part:last-child input[aria-label^=Longest]", "2");
  hand_->press("#arrange");
  page_->wait_for("!document.getElementById('plate').hidden && round.pieces.length === 2");
  // In every way parts are moved by their names, which are buttons.
  hand_->press("#pieces button:last-child");
  const double x = page_->eval("round.pieces[1].x_mm").get<double>();
  page_->eval("document.querySelector('#pieces button:last-child').focus()");
  page_->key("ArrowRight");
  EXPECT_NEAR(page_->eval("round.pieces[1].x_mm").get<double>(), x + 1, 1e-6);
  page_->wait_for("!look.disabled && document.getElementById('plate-said').textContent === ''");
  ::usleep(700'000);
  page_->wait_for("!look.disabled && document.getElementById('plate-said').textContent === ''");
  hand_->type("#speed", "400");
  hand_->press("#queue");
  page_->wait_for(
      "document.getElementById('queue-said').textContent.includes('queued') || "
      "document.getElementById('said-here')");
  EXPECT_EQ(page_->text("queue-said"), "One job is queued.");
  end("plate");
}

TEST_P(Walk, WhatIsWrongIsSaidWhereItIs) {
  begin("/print", kSubmit);
  take({block()});
  hand_->press("#queue");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_EQ(page_->eval("document.activeElement.id"), "speed");
  hand_->hears("#said-here");
  hand_->axe("what is wrong");
  hand_->type("#speed", "999999");
  hand_->press("#queue");
  page_->wait_for("document.getElementById('said-here') && !queue.disabled");
  EXPECT_EQ(page_->eval(
                "(() => { const r = document.getElementById('said-here').getBoundingClientRect(); "
                "return r.top >= 0 && r.bottom <= innerHeight; })()"),
            true);
  hand_->type("#speed", "400");
  hand_->press("#queue");
  page_->wait_for("document.getElementById('queue-said').textContent.includes('One job')");
  end("queued");
}

TEST_P(Walk, JobsAndMachines) {
  const auto filled = fill(farm_);
  write_file(farm_.root + "/bridges.toml",
             "[[bridge]]\nname = \"left\"\nprinter = \"dual-wavelength-dlp\"\n");
  begin("/", kOperate);
  page_->wait_for("document.querySelectorAll('#rows tr').length > 0");
  hand_->press("#rows button.link");
  page_->wait_for("!document.getElementById('detail').hidden");
  hand_->press_named("#farm-actions", "Start no more jobs");
  page_->wait_for("document.getElementById('farm-actions').textContent === 'Start jobs again'");
  EXPECT_TRUE(farm_.model().settings().paused);
  page_->eval("showJob(" + std::to_string(filled.done[0]) + ", true)");
  page_->wait_for("document.getElementById('job-actions').textContent.includes('Print it')");
  hand_->press_named("#job-actions", "Print it");
  page_->wait_for("document.getElementById('bridges').textContent.includes('ended well')");
  end("farm");
}

TEST_P(Walk, AScanOfAPrint) {
  const std::string scan = print_and_scan_hook(farm_);
  begin("/", kSubmit);
  page_->wait_for("document.querySelectorAll('#rows tr').length > 0");
  hand_->press("#rows button.link");
  page_->wait_for("!document.getElementById('scans').hidden");
  hand_->choose("#scan-unit", "mm");
  page_->choose_files("#scan-file", {scan});
  page_->wait_for(
      "document.getElementById('scan-said').textContent.startsWith('The print is off by')");
  hand_->hears("#scan-said");
  page_->wait_for("!document.getElementById('next-box').hidden");
  end("scan");
  hand_->press("#scan-list button");
  page_->wait_for("document.getElementById('scan-list').textContent.includes('No print of this')");
  EXPECT_EQ(page_->eval("document.getElementById('next-box').hidden"), true);
  end("no scan");
}

TEST_P(Walk, AResinAndAPrinter) {
  write_file(farm_.root + "/heights.csv", heights_of_a_resin());
  begin("/materials", kOperate);
  page_->choose_files("#files", {farm_.root + "/heights.csv"});
  page_->wait_for("tables.there.length === 1");
  hand_->type("#resin-name", "lab-clear");
  hand_->choose("#model", "kinetic");
  hand_->press("#fit");
  see("fitted");
  hand_->press("#add-resin");
  page_->wait_for("document.getElementById('resins').textContent.includes('lab-clear')");
  for (const auto& [name, value] : {std::pair{"name", "lab-printer"},
                                    {"width_px", "1920"},
                                    {"height_px", "1080"},
                                    {"pixel_um", "50"},
                                    {"readings", "0 0.1\n64 4\n255 30"}}) {
    hand_->type(fmt::format("#new-printer [name={}]", name), value);
  }
  hand_->press("#new-printer button");
  page_->wait_for("document.getElementById('printers').textContent.includes('lab-printer')");
  end("materials");
}

INSTANTIATE_TEST_SUITE_P(In, Walk,
                         ::testing::Values(Way::mouse, Way::phone, Way::keyboard, Way::reader),
                         [](const auto& way) { return std::string(name_of(way.param)); });

}  // namespace
}  // namespace slicecorr::farm
