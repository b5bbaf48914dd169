// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file hand.hpp
/// How different people use a page: with a mouse, a finger on a phone, keys alone, or a reader of screens.
/// The same walk goes in each way; what can't be reached, seen or heard in it fails.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <thread>

#include "devtools.hpp"

namespace slicecorr::test {

enum class Way { mouse, phone, keyboard, reader };
inline const char* name_of(Way way) {
  static constexpr const char* names[] = {"Mouse", "PhoneInPortrait", "KeyboardAlone",
                                          "ScreenReader"};
  return names[static_cast<int>(way)];
}

class Hand {
 public:
  using Json = nlohmann::json;

  Hand(DrivenPage& page, Way way) : page_(page), way_(way) {
    page_.look_like(way == Way::phone ? kPhone : 1300, way == Way::phone ? 844 : 900, false);
    if (way == Way::phone) {
      page_.ask("Emulation.setTouchEmulationEnabled", {{"enabled", true}, {"maxTouchPoints", 1}});
    }
    if (way == Way::reader) page_.ask("Accessibility.enable");
  }

  /// A button, a link or what is ticked.
  void press(const std::string& selector) {
    page_.wait_for("(() => { const e = " + of(selector) + "; return e && !e.disabled; })()");
    if (way_ == Way::keyboard) {
      reach(selector);
      const bool ticked = page_.eval(of(selector) + ".matches('input')") == true;
      if (ticked &&
          page_.eval(of(selector) + ".checked && " + of(selector) + ".type === 'radio'") != true) {
        page_.key(" ");
      } else if (!ticked) {
        page_.key("Enter");
      }
      return;
    }
    if (way_ == Way::phone) return tap(selector);
    if (way_ == Way::reader)
      hear(selector, {"button", "link", "radio", "checkbox", "DisclosureTriangle"});
    page_.click(selector);
  }
  /// A button by its words, within a part of the page.
  void press_named(const std::string& within, const std::string& words) {
    const std::string found =
        "[..." + of(within) +
        ".querySelectorAll('button, a')].find((b) => b.textContent === " + Json(words).dump() + ")";
    page_.wait_for(found);
    page_.eval(
        "(() => { for (const e of document.querySelectorAll('[data-hand]')) delete e.dataset.hand; " +
        found + ".dataset.hand = 'here'; })()");
    press("[data-hand=here]");
  }
  /// Text or a number into a field.
  void type(const std::string& selector, const std::string& text) {
    if (way_ == Way::keyboard) {
      reach(selector);
    } else if (way_ == Way::phone) {
      tap(selector);
    } else {
      if (way_ == Way::reader) hear(selector, {"textbox", "spinbutton", "searchbox"});
      page_.eval(of(selector) + ".focus()");
    }
    page_.eval("document.activeElement.select()");
    page_.ask("Input.insertText", {{"text", text}});
    EXPECT_EQ(page_.eval(of(selector) + ".value"), text) << selector;
    // Fields tell their change when they are left.
    page_.eval(of(selector) + ".blur()");
  }
  /// One of a list.
  void choose(const std::string& selector, const std::string& value) {
    if (way_ == Way::keyboard) {
      reach(selector);
      const int to = page_
                         .eval("[..." + of(selector) +
                               ".options].findIndex((o) => o.value === " + Json(value).dump() + ")")
                         .get<int>();
      ASSERT_GE(to, 0) << value;
      for (int i = 0; i < 300; ++i) {
        const int at = page_.eval(of(selector) + ".selectedIndex").get<int>();
        if (at == to) break;
        page_.key(at < to ? "ArrowDown" : "ArrowUp");
      }
    } else {
      if (way_ == Way::reader) hear(selector, {"combobox"});
      if (way_ == Way::phone) in_reach(selector);
      page_.eval(
          "(() => { const e = " + of(selector) + "; e.value = " + Json(value).dump() +
          "; for (const n of ['input', 'change']) e.dispatchEvent(new Event(n, {bubbles: true})); })()");
    }
    EXPECT_EQ(page_.eval(of(selector) + ".value"), value) << selector;
  }
  /// What the page says in this element is read out when it changes, and is in the tree that readers have.
  void hears(const std::string& selector) {
    EXPECT_EQ(page_.eval("Boolean(" + of(selector) +
                         ".closest('[role=status],[role=alert],[role=log],[aria-live],output'))"),
              true)
        << selector;
  }
  /// What people with the tool axe find: nothing. Also that nothing is wider than the screen.
  void axe(const std::string& where) {
    EXPECT_EQ(page_.eval("document.documentElement.scrollWidth <= innerWidth"), true) << where;
    EXPECT_EQ(unnamed(), "") << where;
    const char* path = std::getenv("SLICECORR_AXE");
    if (!path) path = "/usr/share/nodejs/axe-core/axe.min.js";
    std::ifstream in(path);
    if (!in) return;
    std::stringstream text;
    text << in.rdbuf();
    page_.eval(text.str() + "; true");
    const std::string found =
        page_
            .eval(
                "axe.run().then((r) => r.violations.map((v) => v.id + ': ' + v.nodes.map((n) => "
                "n.html.slice(0, 120)).join(' | ')).join('\\n'))")
            .get<std::string>();
    EXPECT_EQ(found, "") << where;
  }

 private:
  static constexpr int kPhone = 390;
  /// Fields and buttons of the page's accessibility tree that have no name.
  std::string unnamed() {
    static const std::set<std::string> named{
        "button",    "link",   "textbox", "spinbutton", "combobox", "checkbox",   "radio",
        "searchbox", "slider", "img",     "image",      "region",   "progressbar"};
    std::string list;
    const Json tree = page_.ask("Accessibility.getFullAXTree");
    for (const Json& node : tree["nodes"]) {
      if (node.value("ignored", false) || !node.contains("role")) continue;
      const std::string role = node["role"].value("value", "");
      const std::string name = node.contains("name") ? node["name"].value("value", "") : "";
      if (named.contains(role) && name.empty()) list += role + " ";
    }
    return list;
  }
  static std::string of(const std::string& selector) {
    return "document.querySelector(" + Json(selector).dump() + ")";
  }
  /// By Tab alone, from where the focus is. Of radio buttons one is reached, arrows go to the others.
  void reach(const std::string& selector) {
    const bool radio = page_.eval(of(selector) + ".type === 'radio'") == true;
    const std::string there =
        "(() => { const a = document.activeElement, e = " + of(selector) + "; return a === e; })()";
    const std::string group = "(() => { const a = document.activeElement, e = " + of(selector) +
                              "; return a.type === 'radio' && a.name === e.name; })()";
    for (int i = 0; i < 400; ++i) {
      if (page_.eval(there) == true) return;
      if (radio && page_.eval(group) == true) {
        page_.key("ArrowDown");
        continue;
      }
      page_.key("Tab");
    }
    FAIL() << selector << " is not reached by Tab";
  }
  /// On the screen after scrolling, under nothing else, and large enough for a finger (WCAG 2.5.8). A page whose
  /// pictures still come moves after it was scrolled: it is scrolled anew until it stands, for some seconds.
  void in_reach(const std::string& selector) {
    const std::string look =
        "(() => { const e = " + of(selector) +
        ", t = e.matches('input[type=radio],input[type=checkbox]') ? e.closest('label') : e; "
        "e.scrollIntoView({block: 'center', behavior: 'instant'}); const b = "
        "t.getBoundingClientRect(), x = b.left + b.width / 2, y = b.top + b.height / 2, at = "
        "document.elementFromPoint(x, y); if (b.left < 0 || b.right > innerWidth + 0.5) return "
        "'beside the screen'; if (!at || !(t.contains(at) || at.contains(t))) return 'under ' + (at && "
        "at.outerHTML.slice(0, 80)); if (getComputedStyle(t).display !== 'inline' && b.height < 24) "
        "return 'only ' + b.height + ' px high'; return ''; })()";
    std::string found;
    for (int looks = 0; looks < 50; ++looks) {
      found = page_.eval(look).get<std::string>();
      if (found.empty()) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    ADD_FAILURE() << selector << ": " << found;
  }
  void tap(const std::string& selector) {
    in_reach(selector);
    page_.eval("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
    const std::string where = "(() => { const b = " + of(selector) +
                              ".getBoundingClientRect(); return {x: b.left + b.width / 2, y: b.top "
                              "+ b.height / 2}; })()";
    Json at = page_.eval(where);
    page_.eval(
        "window.tapped = false; addEventListener('click', (e) => { window.tapped ||= !!e.target.closest(" +
        Json(selector).dump() + "); }, {capture: true}); true");
    // A page that moves under the finger, as when a picture comes, has one tap again.
    for (int tries = 0; tries < 2; ++tries) {
      page_.ask("Input.dispatchTouchEvent",
                {{"type", "touchStart"}, {"touchPoints", Json::array({at})}});
      page_.ask("Input.dispatchTouchEvent", {{"type", "touchEnd"}, {"touchPoints", Json::array()}});
      for (int looks = 0; looks < 30; ++looks) {
        if (page_.eval("window.tapped !== false") == true) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
      }
      if (page_.eval(of(selector) + "?.getBoundingClientRect().height > 0") != true) return;
      in_reach(selector);
      at = page_.eval(where);
    }
  }
  /// What a reader of screens says of it: one of these roles, with a name.
  void hear(const std::string& selector, const std::set<std::string>& roles) {
    const Json element = page_.ask("Runtime.evaluate", {{"expression", of(selector)}});
    const Json tree =
        page_.ask("Accessibility.getPartialAXTree",
                  {{"objectId", element["result"]["objectId"]}, {"fetchRelatives", false}});
    const Json& node = tree["nodes"][0];
    EXPECT_FALSE(node.value("ignored", false)) << selector;
    EXPECT_TRUE(roles.contains(node["role"].value("value", ""))) << selector << node["role"];
    EXPECT_NE(node["name"].value("value", ""), "") << selector;
  }

  DrivenPage& page_;
  Way way_;
};

}  // namespace slicecorr::test
