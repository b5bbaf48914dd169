// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A lab's day in a real browser: parts, plate, speed, before and after, queue, resins, printers, machines.
#include "farm_browser.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "farm_scanned.hpp"
#include "ladder.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using namespace slicecorr::test;
using namespace test;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// Whether what is said at a field or button lies on the screen.
constexpr const char* kSaidInSight =
    "(() => { const r = document.getElementById('said-here').getBoundingClientRect(); return r.top >= 0 "
    "&& r.bottom <= innerHeight; })()";

using Browser = LabInABrowser;

TEST_F(Browser, PartsAreMovedOnThePlate) {
  serve();
  const std::string ladder = farm_.root + "/ladder.stl", block = farm_.root + "/block.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  TriangleMesh box;
  slicecorr::test::add_box(box, {-1.5, -0.5, 0}, {1.5, 0.5, 1});
  slicecorr::test::write_stl(block, box);
  open("/print");
  sign_in(kSubmit);
  page_->choose_files("#files", {ladder, block});
  page_->wait_for("parts.there.length === 2");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  EXPECT_EQ(page_->eval("document.getElementById('placing').hidden"), true);
  page_->click("input[name=how][value=plate]");
  EXPECT_EQ(page_->eval("document.getElementById('placing').hidden"), false);
  // As in their files they lie in one another: told with names and volume, nothing is shown.
  page_->click("#look");
  page_->wait_for("document.querySelector('#plate-said .holds')");
  EXPECT_THAT(page_->text("plate-said"),
              ::testing::AllOf(HasSubstr("ladder.stl and"), HasSubstr("block.stl overlap: "),
                               HasSubstr("mm³ belong to both")));
  EXPECT_EQ(page_->eval("document.getElementById('plate').hidden"), true);
  // One button lays them side by side.
  page_->click("#arrange");
  page_->wait_for(
      "!document.getElementById('plate').hidden && round.pieces.length === 2 && placing.places_mm");
  EXPECT_EQ(page_->eval("document.querySelectorAll('#pieces button').length"), 2);
  EXPECT_THAT(page_->text("pieces"), HasSubstr("block.stl: x "));
  const auto x = [&](int k) {
    return page_->eval(fmt::format("round.pieces[{}].x_mm", k)).get<double>();
  };
  const auto y = [&](int k) {
    return page_->eval(fmt::format("round.pieces[{}].y_mm", k)).get<double>();
  };
  EXPECT_TRUE(std::abs(x(0) - x(1)) >= 4.5 || std::abs(y(0) - y(1)) >= 2.5);
  pictures("print-plate");
  // Keys: a part is reached by tab, arrows move it by 1 mm and r turns it where that is allowed.
  const auto settled = [&] {
    page_->wait_for("!look.disabled && document.querySelector('#plate-said').textContent === ''");
    ::usleep(1'000'000);
    page_->wait_for("!look.disabled && document.getElementById('plate-said').textContent === ''");
  };
  settled();
  const double before_x = x(1), before_y = y(1);
  page_->eval("document.querySelectorAll('#pieces button')[1].focus()");
  page_->key("ArrowRight");
  page_->key("ArrowDown");
  page_->key("r");
  EXPECT_NEAR(x(1), before_x + 1, 1e-6);
  EXPECT_NEAR(y(1), before_y - 1, 1e-6);
  EXPECT_EQ(page_->eval("round.pieces[1].quarter_turns"), 0);
  settled();
  page_->click("#turn_about_z");
  page_->eval("document.querySelectorAll('#pieces button')[1].focus()");
  page_->key("r");
  EXPECT_EQ(page_->eval("round.pieces[1].quarter_turns"), 1);
  settled();
  // What the server sliced is what is shown: the plate came back with these places.
  EXPECT_NEAR(x(1), before_x + 1, 1e-6);
  EXPECT_EQ(page_->eval("round.pieces[1].quarter_turns"), 1);
  // The mouse takes what is under it; elsewhere it turns the view.
  const auto drag = [&](const std::string& from, double by) {
    page_->eval(fmt::format(
        "(() => {{ const c = document.getElementById('round'), b = c.getBoundingClientRect(), [x, y] = {0}; "
        "const at = (t, dx) => c.dispatchEvent(new PointerEvent(t, {{pointerId: 1, bubbles: true, clientX: "
        "b.left + x + dx, clientY: b.top + y}})); c.setPointerCapture = () => {{}}; at('pointerdown', 0); "
        "at('pointermove', {1}); at('pointerup', {1}); }})()",
        from, by));
  };
  const std::string on_block =
      "(() => { const c = document.getElementById('round'), r = c.width / c.clientWidth, i = "
      "round.owner.indexOf(2); return [(i % c.width + 2) / r, (Math.floor(i / c.width) + 2) / r]; })()";
  const double drawn_x = x(1), drawn_y = y(1), other = x(0);
  drag(on_block, 25);
  EXPECT_GT(std::hypot(x(1) - drawn_x, y(1) - drawn_y), 0.2);
  EXPECT_EQ(x(0), other);
  EXPECT_EQ(page_->eval("round.chosen"), 1);
  settled();
  const double turn = page_->eval("round.turn").get<double>();
  drag("[3, 3]", 25);
  EXPECT_NE(page_->eval("round.turn").get<double>(), turn);
  // Moved into one another they are told again, and the parts stay in sight.
  page_->eval(fmt::format("round.shift(1, {}, {}); partMoved()", x(0) - x(1), y(0) - y(1)));
  page_->wait_for("document.querySelector('#plate-said .holds')");
  EXPECT_THAT(page_->text("plate-said"), HasSubstr("overlap: "));
  EXPECT_EQ(page_->eval("document.getElementById('plate').hidden"), false);
  // Joined, if that is meant; jobs have the places that are shown.
  page_->click("#join");
  page_->click("#look");
  page_->wait_for("document.querySelector('#plate-said').textContent === '' && !look.disabled");
  const std::string keys = page_->eval("JSON.stringify(setup(parts.there))").get<std::string>();
  EXPECT_THAT(keys, ::testing::AllOf(HasSubstr("places_mm"), HasSubstr("\"quarter_turns\":[0,1]"),
                                     HasSubstr("\"overlap\":\"join\"")));
  page_->set("speed", "400");
  page_->click("#queue");
  page_->wait_for(
      "document.getElementById('queue-said').textContent.includes('queued') || document.getElementById('said-here')");
  EXPECT_THAT(page_->text("queue-said"), HasSubstr("One job is queued"));
}

TEST_F(Browser, FromPartsToTheQueue) {
  serve();
  const std::string ladder = farm_.root + "/ladder.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  // A part that people know, where it is there.
  const std::string benchy = std::string(SLICECORR_TEST_DATA) + "/meshes/clean/3DBenchy.stl";
  const std::string part = fs::exists(benchy) ? fs::canonical(benchy).string()
                                              : std::string(SLICECORR_SOURCE_DIR) +
                                                    "/tests/data/meshes/clean/ksr_fdmtest_v4.stl";
  open("/print");
  EXPECT_EQ(page_->eval("document.getElementById('queue').disabled"), true);
  // What is said before one signs in stays said.
  page_->set("set-window_cure", "allow");
  page_->set("fit_mm", "12");
  sign_in(kOperate);
  EXPECT_EQ(page_->eval("document.getElementById('set-window_cure').value"), "allow");
  EXPECT_EQ(page_->eval("document.getElementById('fit_mm').value"), "12");
  EXPECT_THAT(page_->text("who"), HasSubstr("pia may operate"));
  test::write_file(farm_.root + "/notes.txt", "no part");
  page_->choose_files("#files", {part, ladder, farm_.root + "/notes.txt"});
  page_->wait_for("parts.there.length === 2");
  EXPECT_THAT(page_->text("parts"), HasSubstr("not sent: no part"));
  page_->click("#parts .part:last-child button");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  // All settings are there, few of them at once.
  EXPECT_EQ(page_->eval("document.getElementById('more').open"), false);
  page_->click("#more summary");
  EXPECT_GT(page_->eval("document.querySelectorAll('#settings input, #settings select').length"),
            25);
  EXPECT_THAT(page_->text("settings"), HasSubstr("Gaps one slice high"));
  page_->set("set-gap_shortfall", "0.2");
  EXPECT_EQ(page_->text("more-said"), "(gap_shortfall, window_cure)");
  EXPECT_EQ(page_->eval("JSON.stringify(moreSettings('job'))"),
            R"({"gap_shortfall":0.2,"window_cure":"allow"})");
  pictures("print-settings");
  page_->click("#more summary");

  page_->click("#look");
  see("plate");
  page_->wait_for("document.getElementById('layer-canvas').dataset.layer");
  EXPECT_THAT(page_->text("plate-facts"), HasSubstr("64 x 40 mm"));
  // The part is seen, and turns.
  const auto picture = [&](const char* id) {
    return page_->eval(fmt::format("document.getElementById('{}').toDataURL()", id));
  };
  const auto colours = page_->eval(
      "(() => { const c = document.getElementById('round'), d = c.getContext('2d').getImageData(0, "
      "0, c.width, c.height).data; let n = 0; for (let i = 0; i < d.length; i += 4) if (d[i + 2] > "
      "d[i] + 20) n++; return n / (c.width * c.height); })()");
  EXPECT_GT(colours.get<double>(), 0.03);
  EXPECT_LT(colours.get<double>(), 0.6);
  auto before = picture("round");
  page_->eval("document.getElementById('round').focus()");
  page_->key("ArrowLeft");
  page_->key("+");
  ::usleep(300'000);
  EXPECT_NE(picture("round"), before);
  before = picture("layer-canvas");
  page_->eval("document.getElementById('layer').focus()");
  const int layer = page_->eval("Number(layer.value)").get<int>();
  page_->key("ArrowRight");
  page_->wait_for(
      fmt::format("document.getElementById('layer-canvas').dataset.layer === '{}'", layer + 1));
  EXPECT_THAT(page_->text("layer-said"), HasSubstr(fmt::format("layer {}", layer + 2)));
  EXPECT_NE(picture("layer-canvas"), before);
  before = picture("layer-canvas");
  page_->click("#layer-in");
  EXPECT_NE(picture("layer-canvas"), before);

  page_->click("#plan");
  see("planned");
  EXPECT_THAT(page_->text("plan-words"), HasSubstr("What limits it: "));
  page_->wait_for("document.getElementById('plan-picture').naturalWidth > 100");
  page_->click("#use");
  EXPECT_GT(page_->eval("Number(document.getElementById('speed').value)").get<double>(), 100);

  page_->click("#check");
  see("checked");
  EXPECT_THAT(page_->text("worst"), HasSubstr("The worst place is"));
  EXPECT_THAT(page_->text("figures"), HasSubstr("Height error, mean"));
  page_->wait_for("document.getElementById('section').naturalWidth > 100");

  page_->set("ready", "07:00");
  page_->set("labels", "browser, first");
  page_->click("#queue");
  page_->wait_for("document.getElementById('queue-said').textContent.includes('queued')");
  EXPECT_EQ(page_->text("queue-said"), "2 jobs are queued.");
  pictures("print");
  auto model = farm_.model();
  const auto jobs = model.jobs({});
  ASSERT_EQ(jobs.size(), 2U);
  EXPECT_EQ(jobs[0].user, "pia");
  EXPECT_EQ(jobs[0].labels, (std::vector<std::string>{"browser", "first"}));
  EXPECT_EQ(local_minute(jobs[0].ready_by_ms), 7 * 60);

  // On the farm: reorder, cancel, try again.
  open("/");
  page_->wait_for("document.querySelectorAll('#rows tr').length === 2");
  page_->click("#rows tr:last-child button.link");
  page_->wait_for("!document.getElementById('detail').hidden");
  const auto press = [&](const std::string& words) {
    page_->wait_for(
        "[...document.querySelectorAll('#detail button, #farm-actions button')].some((b) "
        "=> b.textContent === '" +
        words + "')");
    page_->eval(
        "[...document.querySelectorAll('#detail button, #farm-actions button')].find((b) => "
        "b.textContent === '" +
        words + "').click()");
  };
  const JobId last = page_->eval("shown").get<JobId>();
  press("Before all others");
  page_->wait_for("document.querySelector('#rows tr:first-child td:last-child').textContent === '" +
                  std::to_string(last) + "'");
  EXPECT_EQ(farm_.model().job(last)->priority, 1);
  // Where the farm keeps parts is nobody's concern.
  EXPECT_THAT(page_->text("facts"), Not(HasSubstr("uploads/")));
  press("Cancel this job");
  page_->wait_for("document.getElementById('facts').textContent.includes('cancelled')");
  EXPECT_EQ(farm_.model().job(last)->state, JobState::cancelled);
  press("Try again");
  page_->wait_for("document.getElementById('facts').textContent.includes('queued')");
  EXPECT_EQ(farm_.model().job(last)->state, JobState::queued);
  press("Start no more jobs");
  page_->wait_for("document.getElementById('farm-actions').textContent === 'Start jobs again'");
  EXPECT_TRUE(farm_.model().settings().paused);
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

TEST_F(Browser, WhatIsDoneGoesToAMachine) {
  const auto filled = fill(farm_);
  test::write_file(farm_.root + "/bridges.toml",
                   "[[bridge]]\nname = \"left\"\nprinter = \"dual-wavelength-dlp\"\npage = "
                   "\"http://127.0.0.1:8421/\"\n");
  serve();
  open("/");
  sign_in(kOperate);
  page_->wait_for("!document.getElementById('machines').hidden");
  EXPECT_THAT(page_->text("bridges"), HasSubstr("left"));
  page_->eval("showJob(" + std::to_string(filled.done[0]) + ", true)");
  page_->wait_for("document.getElementById('job-actions').textContent.includes('Print it')");
  EXPECT_THAT(page_->text("job-actions"), HasSubstr("Download uvj (5.0 kB)"));
  page_->eval(
      "[...document.querySelectorAll('#job-actions button')].find((b) => b.textContent === "
      "'Print it').click()");
  page_->wait_for("document.getElementById('bridges').textContent.includes('ended well')");
  EXPECT_THAT(page_->text("bridges"), HasSubstr("sent by pia"));
  pictures("farm");
  // A name that would do harm is text here, too.
  page_->eval("showJob(" + std::to_string(filled.nasty) + ", true)");
  page_->wait_for("document.getElementById('detail-title').textContent.includes('<img')");
  EXPECT_EQ(page_->eval("document.querySelectorAll('#detail img').length"), 0);
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

TEST_F(Browser, AResinAndAPrinter) {
  serve();
  test::write_file(farm_.root + "/heights.csv", heights_of_a_resin());
  open("/materials");
  EXPECT_THAT(page_->text("resins"), HasSubstr("benchy-resin"));
  EXPECT_EQ(page_->eval("document.getElementById('new-printer').hidden"), true);
  sign_in(kOperate);
  page_->choose_files("#files", {farm_.root + "/heights.csv"});
  page_->wait_for("tables.there.length === 1");
  page_->set("resin-name", "Bad Name");
  page_->click("#fit");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), HasSubstr("small letters"));
  page_->set("resin-name", "lab-clear");
  page_->set("model", "kinetic");
  page_->click("#fit");
  see("fitted");
  EXPECT_THAT(page_->text("fit-words"), HasSubstr("Fit of 10 measurements"));
  EXPECT_THAT(page_->text("fit-figures"), HasSubstr("Absorbance height"));
  page_->wait_for("document.getElementById('fit-picture').naturalWidth > 100");
  page_->click("#add-resin");
  page_->wait_for("document.getElementById('resins').textContent.includes('lab-clear')");
  page_->set("find", "lab-clear");
  page_->click("#resins button.link");
  page_->wait_for("document.getElementById('curve-picture').naturalWidth > 100");
  for (const auto& [name, value] : {std::pair{"name", "lab-printer"},
                                    {"width_px", "1920"},
                                    {"height_px", "1080"},
                                    {"pixel_um", "50"},
                                    {"readings", "0 0.1\n64 4\n255 30"}}) {
    page_->eval(fmt::format("document.querySelector('#new-printer [name={}]').value = {}", name,
                            nlohmann::json(value).dump()));
  }
  page_->click("#new-printer button");
  page_->wait_for("document.getElementById('printers').textContent.includes('lab-printer')");
  pictures("materials");
  // Both can be chosen for a print.
  open("/print");
  EXPECT_EQ(page_->eval("[...resin.options].some((o) => o.value === 'lab-clear')"), true);
  EXPECT_EQ(page_->eval("[...printer.options].some((o) => o.value === 'lab-printer')"), true);
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

TEST_F(Browser, ByKeyboardAlone) {
  serve();
  const std::string ladder = farm_.root + "/ladder.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  open("/print");
  sign_in(kSubmit);
  page_->choose_files("#files", {ladder});
  page_->wait_for("parts.there.length === 1");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  page_->eval("document.querySelector('nav a').focus()");
  // Everything that can be clicked is reached (a time has parts of its own that show the focus), in the order of the page, and shows that it is.
  std::vector<std::string> reached;
  for (int i = 0; i < 60; ++i) {
    page_->key("Tab");
    const std::string id = page_->eval("document.activeElement.id || ''").get<std::string>();
    if (id.empty()) continue;
    reached.push_back(id);
    const auto seen = page_->eval(
        "(() => { let e = document.activeElement; if (e.type === 'time') return true; if (e.type === 'file') e = e.closest('.drop'); "
        "const s = getComputedStyle(e); return s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) "
        ">= 2; })()");
    EXPECT_EQ(seen, true) << id;
    if (id == "queue") break;
  }
  std::size_t at = 0;
  for (const char* wanted : {"files", "printer", "resin", "layer_um", "mode", "fit_mm", "rotate",
                             "look", "speed", "plan", "check", "ready", "queue"}) {
    const auto found = std::find(reached.begin() + static_cast<long>(at), reached.end(), wanted);
    ASSERT_NE(found, reached.end()) << wanted << ": " << nlohmann::json(reached).dump();
    at = static_cast<std::size_t>(found - reached.begin());
  }
  // Without a speed the queue says what is missing, where a screen reader hears it.
  page_->key("Enter");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), HasSubstr("Say the speed"));
  // It stands at the field, in sight, and the field is where one types.
  EXPECT_EQ(page_->eval("document.activeElement.id"), "speed");
  EXPECT_EQ(page_->eval("document.getElementById('speed').getAttribute('aria-errormessage')"),
            "said-here");
  EXPECT_EQ(page_->eval("document.getElementById('said-here').getAttribute('role')"), "alert");
  EXPECT_TRUE(page_->eval(kSaidInSight).get<bool>());
  page_->set("speed", "800");
  page_->eval("document.getElementById('queue').focus()");
  page_->key("Enter");
  page_->wait_for("document.getElementById('queue-said').textContent.includes('One job')");
  EXPECT_EQ(farm_.model().jobs({})[0].user, "sam");
  // Every field has a name that is read out.
  EXPECT_EQ(page_->eval("[...document.querySelectorAll('input, select, textarea')].filter((e) => "
                        "!e.labels.length && !e.getAttribute('aria-label')).length"),
            0);
}

TEST_F(Browser, WhoMayOnlyLookIsTold) {
  fill(farm_);
  serve();
  open("/print");
  EXPECT_THAT(page_->text("all"), HasSubstr("You may look"));
  open("/");
  page_->wait_for("document.querySelectorAll('#rows tr').length > 0");
  page_->click("#rows button.link");
  page_->wait_for("!document.getElementById('detail').hidden");
  EXPECT_THAT(page_->text("detail"), Not(HasSubstr("Cancel this job")));
  EXPECT_EQ(page_->text("farm-actions"), "");
  EXPECT_THAT(page_->complaints(), IsEmpty());
  // A wrong token is refused as such, and takes nothing away.
  page_->click("#who button");
  page_->set("token", std::string(40, 'x'));
  page_->click("#ask button");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), HasSubstr("This token is none of this farm"));
  EXPECT_EQ(page_->eval("document.activeElement.id"), "token");
  EXPECT_EQ(page_->eval("me.role"), "look");
  EXPECT_EQ(page_->eval("sessionStorage.getItem('token')"), nullptr);
  page_->set("token", kSubmit);
  page_->click("#ask button");
  page_->wait_for("me.role === 'submit'");
}

TEST_F(Browser, WhatWorksIsChosenFirstAndFound) {
  serve();
  open("/print");
  sign_in(kSubmit);
  // A printer whose light is known, and a resin that was measured in such light.
  EXPECT_EQ(page_->eval("measured(printerNow()) && goes(resin.value)"), true);
  EXPECT_THAT(page_->eval("[...printer.children].map((g) => g.label).join()").get<std::string>(),
              HasSubstr("Light to be measured"));
  // Both lists are looked through; what is chosen stays.
  const std::string was = page_->eval("printer.value").get<std::string>();
  page_->eval(
      "(() => { const e = document.getElementById('find-printer'); e.value = 'saturn'; "
      "e.dispatchEvent(new Event('input', {bubbles: true})); })()");
  EXPECT_EQ(page_->eval("printer.value"), was);
  EXPECT_GT(page_->eval("printer.options.length"), 1);
  EXPECT_LT(page_->eval("printer.options.length"), 8);
  EXPECT_THAT(page_->text("light-said"), HasSubstr("in the list"));
  // One whose light is to be measured shows the part all the same.
  page_->set("printer", "elegoo-saturn");
  EXPECT_THAT(page_->text("light-said"), HasSubstr("Show works"));
  slicecorr::test::write_stl(farm_.root + "/ladder.stl", slicecorr::test::ladder());
  page_->choose_files("#files", {farm_.root + "/ladder.stl"});
  page_->wait_for("parts.there.length === 1");
  page_->click("#look");
  see("plate");
  // Layer by layer it gets a file that it reads.
  page_->set("mode", "layerwise");
  EXPECT_EQ(page_->eval("formatOf(parts.there)"),
            page_->eval("printerNow().reads.map((e) => e.slice(1)).find((e) => formats.some((f) => "
                        "f.made_new && f.endings.includes('.' + e)))"));
  // What programs read can be dropped, by the table of formats.
  for (const FormatInfo& f : archive_formats()) {
    for (const std::string& ending : f.endings) {
      EXPECT_EQ(page_->eval("partName.test('Part" + ending + "')"), true) << ending;
    }
  }
  EXPECT_EQ(page_->eval("partName.test('part.txt')"), false);
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

TEST_F(Browser, SeveralPartsHaveSizesAndNumbersOfTheirOwn) {
  serve();
  const std::string ladder = farm_.root + "/ladder.stl", block = farm_.root + "/block.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  TriangleMesh box;
  slicecorr::test::add_box(box, {-1.5, -0.5, 0}, {1.5, 0.5, 1});
  slicecorr::test::write_stl(block, box);
  open("/print");
  sign_in(kSubmit);
  page_->choose_files("#files", {ladder, block});
  page_->wait_for("parts.there.length === 2");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  page_->set("fit_mm", "3");
  page_->set("speed", "400");
  const auto own = [&](int part, const std::string& key, const std::string& value) {
    page_->eval(
        fmt::format("(() => {{ const e = parts.items[{}].own.{}; e.value = '{}'; "
                    "e.dispatchEvent(new Event('change')); }})()",
                    part, key, value));
  };
  own(1, "fit_mm", "2");
  own(1, "rotate_deg", "0,0,90");
  own(1, "copies", "3");
  page_->click("#queue");
  page_->wait_for(
      "document.getElementById('queue-said').textContent.includes('queued') || "
      "document.getElementById('said-here')");
  EXPECT_EQ(page_->text("queue-said"), "4 jobs are queued.");
  int blocks = 0;
  for (const Job& j : farm_.model().jobs({})) blocks += j.name.starts_with("block") ? 1 : 0;
  EXPECT_EQ(blocks, 3);
  // On one plate: as many as are asked for, side by side.
  page_->click("input[name=how][value=plate]");
  EXPECT_EQ(page_->eval("parts.items[1].own.fit_mm.parentElement.hidden"), false);
  EXPECT_EQ(page_->eval("chosen().length"), 4);
  EXPECT_EQ(
      page_->eval("JSON.stringify([setup(chosen()).own_fit_mm, setup(chosen()).own_rotate_deg])"),
      "[[0,2,2,2],[0,0,0,0,0,90,0,0,90,0,0,90]]");
  page_->click("#look");
  see("plate");
  page_->wait_for("round.pieces.length === 4");
  // Blocks of 3 x 1 x 1 mm, 2 mm long and turned; the ladder of 4 mm 3 mm long.
  const auto size = [&](int part, int axis) {
    return page_->eval(fmt::format(
        "(() => {{ let a = Infinity, b = -Infinity; const t = round.parts.places, p = round.pieces[{}]; for (let i = 9 * "
        "p.from; i < 9 * p.to; i += 3) {{ a = Math.min(a, t[i + {}]); b = Math.max(b, t[i + {}]); }} return b "
        "- a; }})()",
        part, axis, axis));
  };
  const auto of = [&](int part, int axis) { return size(part, axis).get<double>(); };
  EXPECT_NEAR(of(0, 0), 3, 0.01);
  EXPECT_NEAR(of(1, 0), 2.0 / 3, 0.01);
  EXPECT_NEAR(of(1, 1), 2, 0.01);
  page_->click("#queue");
  page_->wait_for(
      "document.getElementById('queue-said').textContent.includes('queued') || "
      "document.getElementById('said-here')");
  EXPECT_EQ(page_->text("queue-said"), "One job is queued.");
}

TEST_F(Browser, OneBadPartOfThreeIsNamedAndTheOthersGoOn) {
  serve();
  const std::string ladder = farm_.root + "/ladder.stl", block = farm_.root + "/block.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  TriangleMesh box;
  slicecorr::test::add_box(box, {-1.5, -0.5, 0}, {1.5, 0.5, 1});
  slicecorr::test::write_stl(block, box);
  test::write_file(farm_.root + "/broken.stl", std::string(200, 'x'));
  open("/print");
  sign_in(kSubmit);
  // Refused later than one that can't be read: too thin to be sliced.
  TriangleMesh sheet;
  slicecorr::test::add_box(sheet, {-1, -1, 0}, {1, 1, 0.001});
  slicecorr::test::write_stl(farm_.root + "/flat.stl", sheet);
  page_->choose_files("#files",
                      {ladder, farm_.root + "/broken.stl", block, farm_.root + "/flat.stl"});
  page_->wait_for("parts.there.length === 4");
  page_->set("fit_mm", "3");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  page_->set("speed", "400");
  page_->click("#queue");
  page_->wait_for(
      "document.getElementById('queue-said').textContent.includes('queued') || "
      "document.getElementById('said-here')");
  EXPECT_EQ(page_->text("queue-said"), "2 jobs are queued.");
  const std::string said = page_->text("queued");
  EXPECT_THAT(said, HasSubstr("broken.stl was not queued: "));
  EXPECT_THAT(said, HasSubstr("flat.stl was not queued: The part is "));
  EXPECT_THAT(said, Not(HasSubstr(farm_.root)));
  EXPECT_THAT(said, Not(HasSubstr("upload")));
  EXPECT_EQ(page_->eval("document.querySelector('#queued [role=alert]') !== null"), true);
  EXPECT_EQ(farm_.model().jobs({}).size(), 2U);
  // Together on a plate it is named.
  page_->click("input[name=how][value=plate]");
  page_->click("#look");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), HasSubstr("broken.stl: "));
  EXPECT_THAT(page_->text("said-here"), Not(HasSubstr(farm_.root)));
}

TEST_F(Browser, ASlicersFileBringsItsExposures) {
  const std::string file = farm_.root + "/part.ctb";
  const auto made =
      slicecorr::test::run_program({std::string(SLICECORR_BIN_DIR) + "/slicecorr", "testpart", "f",
                                    "--printer", "elegoo-mars", "--exposure-s", "2.5", "-o", file});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  serve();
  open("/print");
  sign_in(kSubmit);
  page_->set("printer", "elegoo-mars");
  page_->set("resin", "liqcreate-strong-x-405nm");
  EXPECT_EQ(page_->eval("mode.value"), "layerwise");
  page_->choose_files("#files", {file});
  page_->wait_for("parts.there.length === 1");
  EXPECT_EQ(page_->eval("document.getElementById('speed').placeholder"), "as in the file");
  // What its light is nobody measured: the field that helps is named in the words of the page.
  page_->click("#check");
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), Not(HasSubstr("--")));
  EXPECT_THAT(page_->text("light-said"), HasSubstr("Assume"));
  page_->set("set-assume", "typical");
  page_->click("#check");
  see("checked");
  EXPECT_THAT(page_->text("figures"), HasSubstr("Height error, mean"));
  // Nothing stands empty: as sliced is on the whole page.
  EXPECT_THAT(page_->text("figures"), Not(HasSubstr("as sliced")));
}

TEST_F(Browser, OneSignInIsThatOfAllTabs) {
  serve();
  open("/print");
  sign_in(kSubmit);
  EXPECT_EQ(page_->eval(
                "new Promise((done) => { const other = new BroadcastChannel('slicecorr-farm'); "
                "other.onmessage = (e) => done(e.data.token); other.postMessage({want: true}); })"),
            kSubmit);
}

TEST_F(Browser, AScanMakesTheNextPrint) {
  const std::string scan = print_and_scan_hook(farm_);
  // Prints before it, of which the last one lies beyond its band.
  for (const double mean : {1.0, -0.5, 0.8, -1.0, 0.4, -0.2, 0.9, -0.6, 0.3, 0.1}) {
    KeptScan s;
    s.job = 1;
    s.file = "monday <img src=x>.ply";
    s.mean_um = mean;
    s.mean_abs_um = 2 + mean / 4;
    farm_.queue.add_scan(s);
  }
  serve();
  open("/");
  sign_in(kOperate);
  page_->eval("showJob(1, true)");
  page_->wait_for("!document.getElementById('scans').hidden");
  // Another part is refused with what is left between both, where the person looks.
  slicecorr::test::write_stl(farm_.root + "/ball.stl", slicecorr::test::sphere(1.9, 3));
  page_->choose_files("#scan-file", {farm_.root + "/ball.stl"});
  page_->wait_for("document.getElementById('said-here')");
  EXPECT_THAT(page_->text("said-here"), AllOf(HasSubstr("nother part"), HasSubstr("um")));
  page_->choose_files("#scan-file", {scan});
  page_->wait_for(
      "document.getElementById('scan-said').textContent.startsWith('The print is off by')");
  page_->wait_for("document.getElementById('scan-list').textContent.includes('printed.ply')");
  // It prints otherwise than those before: the page says so, with the chart.
  page_->wait_for("document.getElementById('drifts').textContent.includes('beyond its band')");
  page_->wait_for("document.querySelector('#drifts img').naturalWidth > 100");
  EXPECT_EQ(page_->eval("document.querySelectorAll('#scan-list img').length"), 0);
  pictures("drift");
  for (int number = 1; number <= 10; ++number) {
    farm_.queue.remove_scan(1, number, "pia");
  }
  page_->eval("look()");
  page_->wait_for("document.querySelectorAll('#scan-list .scan').length === 1");
  page_->click("#scan-next");
  page_->wait_for(
      "document.getElementById('next-said').textContent.includes('is queued, corrected')");
  EXPECT_THAT(page_->text("next-said"), HasSubstr("Job 2"));
  page_->eval(
      "[...document.querySelectorAll('#next-said button')].find((b) => b.textContent === "
      "'Add the resin').click()");
  page_->wait_for("document.getElementById('next-said').textContent.includes('is there')");
  pictures("scans");
  page_->eval("showJob(2, true)");
  page_->wait_for("document.getElementById('facts').textContent.includes('scans of job 1')");
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

}  // namespace
}  // namespace slicecorr::farm
