// See ../../README.md.
#pragma once
#include "geometry_msgs/msg/wrench_stamped.hpp"
namespace needle_twin::msg
{
struct Safety
{
  std_msgs::msg::Header header;
  bool safe;
};
}  // namespace needle_twin::msg
