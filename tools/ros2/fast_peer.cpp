// Plays frames to the node as a camera on Fast DDS, the middleware of rmw_fastrtps, and prints the results.
//
// usage: fast_peer FRAMES.bin [rel]; FRAMES.bin is written by dump.py. Build: see README.md.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdint>
#include <fstream>
#include <map>
#include <thread>
#include <vector>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include "rosPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

struct Frame { double stamp; int64_t colour_ns, depth_ns; std::vector<uint8_t> colour, depth; };

template <class T> T get(std::istream& in) { T v{}; in.read(reinterpret_cast<char*>(&v), sizeof v); return v; }

int main(int argc, char** argv) {
  std::ifstream in(argv[1], std::ios::binary);
  const bool reliable = argc > 2;
  const uint32_t count = get<uint32_t>(in), width = get<uint32_t>(in), height = get<uint32_t>(in);
  double camera[9];
  for (double& v : camera) v = get<double>(in);
  std::vector<Frame> frames(count);
  for (Frame& f : frames) {
    f.stamp = get<double>(in); f.colour_ns = get<int64_t>(in); f.depth_ns = get<int64_t>(in);
    f.colour.resize(3 * width * height); f.depth.resize(2 * width * height);
    in.read(reinterpret_cast<char*>(f.colour.data()), f.colour.size());
    in.read(reinterpret_cast<char*>(f.depth.data()), f.depth.size());
  }
  DomainParticipantQos pq;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  udp->sendBufferSize = udp->receiveBufferSize = 4 << 20;
  pq.transport().use_builtin_transports = false;
  pq.transport().user_transports.push_back(udp);
  auto* p = DomainParticipantFactory::get_instance()->create_participant(0, pq);
  auto* pub = p->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* sub = p->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  TypeSupport image(new sensor_msgs::msg::dds_::Image_PubSubType()), info(new sensor_msgs::msg::dds_::CameraInfo_PubSubType()),
      odometry(new nav_msgs::msg::dds_::Odometry_PubSubType());
  for (TypeSupport* t : {&image, &info, &odometry}) t->register_type(p);
  auto writer = [&](const char* name, TypeSupport& type) {
    DataWriterQos q;
    q.history().kind = KEEP_LAST_HISTORY_QOS; q.history().depth = 5;
    q.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    q.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
    q.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return pub->create_datawriter(p->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT), q);
  };
  auto* colour = writer("rt/camera/color/image_raw", image);
  auto* depth = writer("rt/camera/aligned_depth_to_color/image_raw", image);
  auto* infos = writer("rt/camera/color/camera_info", info);
  DataReaderQos rq;
  rq.history().kind = KEEP_LAST_HISTORY_QOS; rq.history().depth = 100; rq.reliability().kind = RELIABLE_RELIABILITY_QOS;
  rq.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  auto* reader = sub->create_datareader(p->create_topic("rt/stillpoint/odometry", odometry.get_type_name(), TOPIC_QOS_DEFAULT), rq);
  PublicationMatchedStatus a, b; SubscriptionMatchedStatus c;
  for (int i = 0; i < 200; i++) {
    colour->get_publication_matched_status(a); depth->get_publication_matched_status(b); reader->get_subscription_matched_status(c);
    if (a.current_count && b.current_count && c.current_count) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  std::map<int64_t, Clock::time_point> complete;
  std::vector<double> late; unsigned got = 0;
  auto take = [&] {
    nav_msgs::msg::dds_::Odometry_ o; SampleInfo si;
    while (reader->take_next_sample(&o, &si) == ReturnCode_t::RETCODE_OK) if (si.valid_data) {
      got++;
      const int64_t ns = int64_t(o.header().stamp().sec()) * 1000000000 + o.header().stamp().nanosec();
      auto at = complete.find(ns);
      if (at != complete.end()) late.push_back(Seconds(Clock::now() - at->second).count() * 1e3);
    }
  };
  auto header = [](std_msgs::msg::dds_::Header_& h, int64_t ns) {
    h.stamp().sec(ns / 1000000000); h.stamp().nanosec(ns % 1000000000); h.frame_id("camera_color_optical_frame");
  };
  sensor_msgs::msg::dds_::Image_ rgb, mm; sensor_msgs::msg::dds_::CameraInfo_ ci;
  for (auto* m : {&rgb, &mm}) { m->height(height); m->width(width); }
  rgb.encoding("rgb8"); rgb.step(3 * width); mm.encoding("16UC1"); mm.step(2 * width);
  ci.height(height); ci.width(width); ci.distortion_model("plumb_bob");
  ci.d(std::vector<double>(camera + 4, camera + 9));
  ci.k() = {camera[0], 0, camera[2], 0, camera[1], camera[3], 0, 0, 1};
  ci.p() = {camera[0], 0, camera[2], 0, 0, camera[1], camera[3], 0, 0, 0, 1, 0};
  const auto begin = Clock::now();
  for (const Frame& f : frames) {
    const auto due = begin + std::chrono::duration_cast<Clock::duration>(Seconds(f.stamp - frames[0].stamp));
    while (Clock::now() < due) { take(); std::this_thread::sleep_for(std::chrono::milliseconds(1)); }
    header(ci.header(), f.colour_ns); infos->write(&ci);
    header(rgb.header(), f.colour_ns); rgb.data(f.colour); colour->write(&rgb);
    header(mm.header(), f.depth_ns); mm.data(f.depth); depth->write(&mm);
    complete[f.colour_ns] = Clock::now();
  }
  for (int i = 0; i < 1000; i++) { take(); std::this_thread::sleep_for(std::chrono::milliseconds(2)); }
  std::sort(late.begin(), late.end());
  auto at = [&](double q) { return late.empty() ? 0.0 : late[size_t(q * (late.size() - 1))]; };
  printf("Fast DDS %s: sent %u, odometry %u, latency median %.1f ms, p95 %.1f ms\n", reliable ? "reliable" : "best effort", count, got, at(0.5), at(0.95));
}
