// See ../README.md.
#pragma once
#include <memory>
#define PLUGINLIB_EXPORT_CLASS(derived, base) \
  std::unique_ptr<base> exported_by_pluginlib() { return std::make_unique<derived>(); }
