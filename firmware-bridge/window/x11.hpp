// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What SDL2 does not do under X11: names of outputs, power saving, what covers a window, and a
/// server that dies without taking the process with it. Where there is no X11 nothing here does
/// anything.
#pragma once

#include <functional>
#include <string>

struct SDL_Window;
struct SDL_SysWMmsg;

namespace slicecorr::bridge::detail {

class X11 {
 public:
  /// Xlib ends the process when the server is gone or says that a request was wrong. Instead: the
  /// former tells `died` and keeps the thread for ever, because nothing in Xlib or SDL is fit to be
  /// gone on with; the latter is kept for `error`. Gives what is against it: another window of this
  /// process, or a server that has died in it.
  static std::string guard(std::function<void(const std::string&)> died);
  static void unguard();

  /// Whether the output of this name ("HDMI-1") has its upper left corner here.
  static bool has_output_at(const std::string& name, int x, int y);

  void take(SDL_Window* window);
  /// No power saving until `restore`.
  void keep_awake();
  void restore();
  /// Asks for events that say whether the window is covered.
  void follow_window();
  /// Whether such events come: not under a compositor, for which all windows are whole.
  bool knows_what_covers() const { return followed_ && !composited_; }
  bool unobscured() const { return !knows_what_covers() || unobscured_; }
  std::string judge(const SDL_SysWMmsg* message);
  /// Waits until the server has done all; what it had against it.
  std::string sync();
  std::string error() const;

 private:
  void* display_ = nullptr;  ///< Xlib's Display; null: another kind of server
  unsigned long window_ = 0;
  bool followed_ = false, composited_ = false, unobscured_ = false, saved_power_ = false;
};

}  // namespace slicecorr::bridge::detail
