// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "window/x11.hpp"

#define SDL_MAIN_HANDLED
#include <SDL.h>
#include <SDL_syswm.h>
#include <X11/Xlib.h>
#include <X11/extensions/Xrandr.h>
#include <X11/extensions/dpms.h>
#include <unistd.h>

#include <atomic>
#include <utility>

namespace slicecorr::bridge::detail {
namespace {

// One window to a process, and handlers without an argument: hence at file scope.
std::function<void(const std::string&)> tell_died;
std::string first_error;
std::atomic<bool> in_use{false}, server_died{false};
XIOErrorHandler old_io_handler = nullptr;
XErrorHandler old_handler = nullptr;

int on_io_error(Display*) {
  server_died = true;
  if (tell_died) tell_died("the display server is gone");
  while (true) ::pause();
}

int on_error(Display* display, XErrorEvent* event) {
  char text[128] = "";
  XGetErrorText(display, event->error_code, text, sizeof text);
  if (first_error.empty()) first_error = std::string("the display server says: ") + text;
  return 0;
}

Display* display_of(void* display) { return static_cast<Display*>(display); }

}  // namespace

std::string X11::guard(std::function<void(const std::string&)> died) {
  if (server_died) return "its display server died; expected a new process for another window";
  if (in_use.exchange(true)) return "this process has a window already";
  tell_died = std::move(died);
  first_error.clear();
  old_io_handler = XSetIOErrorHandler(on_io_error);
  old_handler = XSetErrorHandler(on_error);
  return "";
}

void X11::unguard() {
  XSetIOErrorHandler(old_io_handler);
  XSetErrorHandler(old_handler);
  tell_died = nullptr;
  in_use = false;
}

bool X11::has_output_at(const std::string& name, int x, int y) {
  const char* driver = SDL_GetCurrentVideoDriver();
  if (!driver || std::string(driver) != "x11") return false;
  Display* const display = XOpenDisplay(nullptr);
  if (!display) return false;
  bool there = false;
  int event = 0, error = 0;
  XRRScreenResources* const all =
      XRRQueryExtension(display, &event, &error)
          ? XRRGetScreenResourcesCurrent(display, DefaultRootWindow(display))
          : nullptr;
  for (int i = 0; all && i < all->noutput && !there; ++i) {
    XRROutputInfo* const output = XRRGetOutputInfo(display, all, all->outputs[i]);
    if (!output) continue;
    XRRCrtcInfo* const crtc =
        output->crtc && name == output->name ? XRRGetCrtcInfo(display, all, output->crtc) : nullptr;
    if (crtc) {
      there = crtc->x == x && crtc->y == y;
      XRRFreeCrtcInfo(crtc);
    }
    XRRFreeOutputInfo(output);
  }
  if (all) XRRFreeScreenResources(all);
  XCloseDisplay(display);
  return there;
}

void X11::take(SDL_Window* window) {
  SDL_SysWMinfo info{};
  SDL_VERSION(&info.version);
  if (!SDL_GetWindowWMInfo(window, &info) || info.subsystem != SDL_SYSWM_X11) return;
  display_ = info.info.x11.display;
  window_ = info.info.x11.window;
}

void X11::keep_awake() {
  if (!display_) return;
  Display* const display = display_of(display_);
  int event = 0, error = 0;
  CARD16 level = 0;
  BOOL on = False;
  if (DPMSQueryExtension(display, &event, &error) && DPMSCapable(display) &&
      DPMSInfo(display, &level, &on) && on) {
    if (level != DPMSModeOn) DPMSForceLevel(display, DPMSModeOn);
    DPMSDisable(display);
    saved_power_ = true;
  }
  XForceScreenSaver(display, ScreenSaverReset);
}

void X11::restore() {
  if (display_ && saved_power_) DPMSEnable(display_of(display_));
  saved_power_ = false;
}

void X11::follow_window() {
  if (!display_) return;
  Display* const display = display_of(display_);
  const std::string manager = "_NET_WM_CM_S" + std::to_string(DefaultScreen(display));
  composited_ = XGetSelectionOwner(display, XInternAtom(display, manager.c_str(), False)) != None;
  XWindowAttributes attributes{};
  if (!XGetWindowAttributes(display, window_, &attributes)) return;
  XSelectInput(display, window_, attributes.your_event_mask | VisibilityChangeMask);
  followed_ = true;
}

std::string X11::judge(const SDL_SysWMmsg* message) {
  if (!display_ || !message || message->subsystem != SDL_SYSWM_X11) return "";
  const XEvent& event = message->msg.x11.event;
  if (event.xany.window != window_) return "";
  if (event.type == DestroyNotify) return "the window was destroyed";
  if (event.type != VisibilityNotify || composited_) return "";
  unobscured_ = event.xvisibility.state == VisibilityUnobscured;
  return unobscured_ ? "" : "another window covers the images";
}

std::string X11::sync() {
  if (display_) XSync(display_of(display_), False);
  return error();
}

std::string X11::error() const { return display_ ? first_error : ""; }

}  // namespace slicecorr::bridge::detail
