// Calls a Trigger service of the node as rmw_fastrtps does: fast_ask SERVICE. Build like fast_peer.
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
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

int main(int, char** argv) {
  const std::string name = argv[1];
  DomainParticipantQos pq;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  pq.transport().use_builtin_transports = false;
  pq.transport().user_transports.push_back(udp);
  auto* p = DomainParticipantFactory::get_instance()->create_participant(0, pq);
  TypeSupport ask(new std_srvs::srv::dds_::Trigger_Request_PubSubType()), answer(new std_srvs::srv::dds_::Trigger_Response_PubSubType());
  ask.register_type(p);
  answer.register_type(p);
  DataReaderQos rq;
  rq.reliability().kind = RELIABLE_RELIABILITY_QOS;
  DataWriterQos wq;
  wq.reliability().kind = RELIABLE_RELIABILITY_QOS;
  auto* reader = p->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(
      p->create_topic("rr/stillpoint/" + name + "Reply", answer.get_type_name(), TOPIC_QOS_DEFAULT), rq);
  auto* writer = p->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(
      p->create_topic("rq/stillpoint/" + name + "Request", ask.get_type_name(), TOPIC_QOS_DEFAULT), wq);
  PublicationMatchedStatus a; SubscriptionMatchedStatus b;
  for (int i = 0; i < 200; i++) {
    writer->get_publication_matched_status(a);
    reader->get_subscription_matched_status(b);
    if (a.current_count && b.current_count) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  // Sets the reader of the answer; the middleware fills in the number.
  eprosima::fastrtps::rtps::WriteParams params;
  params.related_sample_identity().writer_guid() = reader->guid();
  std_srvs::srv::dds_::Trigger_Request_ request;
  request.structure_needs_at_least_one_member(0);
  writer->write(&request, params);
  const auto wanted = params.sample_identity().sequence_number();
  for (int i = 0; i < 500; i++) {
    std_srvs::srv::dds_::Trigger_Response_ response; SampleInfo info;
    while (reader->take_next_sample(&response, &info) == ReturnCode_t::RETCODE_OK) if (info.valid_data) {
      const auto& related = info.related_sample_identity;
      const bool ours = related.writer_guid() == reader->guid() && related.sequence_number() == wanted;
      printf("%s: %s '%s'%s\n", name.c_str(), response.success() ? "true" : "false", response.message().c_str(), ours ? "" : " (of another request)");
      return ours ? 0 : 1;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  printf("%s: no answer\n", name.c_str());
  return 1;
}
