// See ../../README.md.
#pragma once
#include <cstdint>
#include <string>
namespace builtin_interfaces::msg
{
struct Time
{
  std::int32_t sec;
  std::uint32_t nanosec;
};
}  // namespace builtin_interfaces::msg
namespace std_msgs::msg
{
struct Header
{
  builtin_interfaces::msg::Time stamp;
  std::string frame_id;
};
}  // namespace std_msgs::msg
namespace geometry_msgs::msg
{
struct Vector3
{
  double x, y, z;
};
struct Wrench
{
  Vector3 force, torque;
};
struct WrenchStamped
{
  std_msgs::msg::Header header;
  Wrench wrench;
};
}  // namespace geometry_msgs::msg
