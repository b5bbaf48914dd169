// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "onlooker.hpp"

#include <X11/Xlib.h>
#include <X11/Xutil.h>
#include <X11/cursorfont.h>
#include <X11/extensions/Xfixes.h>
#include <X11/extensions/dpms.h>

#include <stdexcept>

namespace slicecorr::test {

struct Onlooker::Impl {
  Display* display;
  Window root;
  XWindowAttributes screen() const {
    XWindowAttributes a{};
    XGetWindowAttributes(display, root, &a);
    return a;
  }
  void sync() const { XSync(display, False); }
};

Onlooker::Onlooker() : impl_(std::make_unique<Impl>()) {
  impl_->display = XOpenDisplay(nullptr);
  if (impl_->display == nullptr) throw std::runtime_error("no display server");
  impl_->root = DefaultRootWindow(impl_->display);
}
Onlooker::~Onlooker() { XCloseDisplay(impl_->display); }

std::vector<std::uint32_t> Onlooker::grab() const {
  const XWindowAttributes a = impl_->screen();
  XImage* const image = XGetImage(impl_->display, impl_->root, 0, 0, static_cast<unsigned>(a.width),
                                  static_cast<unsigned>(a.height), AllPlanes, ZPixmap);
  if (image == nullptr || image->bits_per_pixel != 32) throw std::runtime_error("no picture");
  std::vector<std::uint32_t> pixels;
  for (int y = 0; y < image->height; ++y) {
    const auto* row =
        reinterpret_cast<const std::uint32_t*>(image->data + y * image->bytes_per_line);
    for (int x = 0; x < image->width; ++x) pixels.push_back(row[x] & 0xFFFFFFU);
  }
  XDestroyImage(image);
  return pixels;
}

void Onlooker::paint_root(std::uint32_t colour) {
  XSetWindowBackground(impl_->display, impl_->root, colour);
  XClearWindow(impl_->display, impl_->root);
  impl_->sync();
}

Onlooker::Id Onlooker::image_window() const {
  Window root = 0, parent = 0, *children = nullptr, found = 0;
  unsigned count = 0;
  const XWindowAttributes screen = impl_->screen();
  XQueryTree(impl_->display, impl_->root, &root, &parent, &children, &count);
  for (unsigned i = 0; i < count; ++i) {
    XWindowAttributes a{};
    XGetWindowAttributes(impl_->display, children[i], &a);
    if (a.map_state == IsViewable && a.width == screen.width && a.height == screen.height) {
      found = children[i];
    }
  }
  if (children != nullptr) XFree(children);
  return found;
}

Onlooker::Id Onlooker::cover(int x, int y, int width, int height) {
  XSetWindowAttributes a{};
  a.override_redirect = True;
  a.background_pixel = 0xFFFFFF;
  const Window w = XCreateWindow(impl_->display, impl_->root, x, y, static_cast<unsigned>(width),
                                 static_cast<unsigned>(height), 0, CopyFromParent, InputOutput,
                                 CopyFromParent, CWOverrideRedirect | CWBackPixel, &a);
  XMapRaised(impl_->display, w);
  impl_->sync();
  return w;
}
void Onlooker::move(Id window, int x, int y) {
  XMoveWindow(impl_->display, window, x, y);
  impl_->sync();
}
void Onlooker::resize(Id window, int width, int height) {
  XResizeWindow(impl_->display, window, static_cast<unsigned>(width),
                static_cast<unsigned>(height));
  impl_->sync();
}
void Onlooker::unmap(Id window) {
  XUnmapWindow(impl_->display, window);
  impl_->sync();
}
void Onlooker::destroy(Id window) {
  XDestroyWindow(impl_->display, window);
  impl_->sync();
}
void Onlooker::close(Id window) {
  XEvent e{};
  e.xclient.type = ClientMessage;
  e.xclient.window = window;
  e.xclient.message_type = XInternAtom(impl_->display, "WM_PROTOCOLS", False);
  e.xclient.format = 32;
  e.xclient.data.l[0] = static_cast<long>(XInternAtom(impl_->display, "WM_DELETE_WINDOW", False));
  XSendEvent(impl_->display, window, False, NoEventMask, &e);
  impl_->sync();
}
void Onlooker::kill_client(Id window) {
  XKillClient(impl_->display, window);
  impl_->sync();
}

void Onlooker::put_pointer(int x, int y) {
  XWarpPointer(impl_->display, None, impl_->root, 0, 0, 0, 0, x, y);
  XDefineCursor(impl_->display, impl_->root, XCreateFontCursor(impl_->display, XC_left_ptr));
  impl_->sync();
}
bool Onlooker::pointer_is_seen() const {
  XFixesCursorImage* const image = XFixesGetCursorImage(impl_->display);
  bool seen = false;
  for (int i = 0; i < image->width * image->height; ++i) {
    seen = seen || (image->pixels[i] >> 24 & 0xFF) != 0;
  }
  XFree(image);
  return seen;
}

std::optional<bool> Onlooker::saves_power() const {
  int event = 0, error = 0;
  CARD16 level = 0;
  BOOL on = False;
  if (!DPMSQueryExtension(impl_->display, &event, &error) || !DPMSCapable(impl_->display) ||
      !DPMSInfo(impl_->display, &level, &on)) {
    return {};
  }
  return on != 0;
}
void Onlooker::save_power() {
  DPMSEnable(impl_->display);
  impl_->sync();
}

}  // namespace slicecorr::test
