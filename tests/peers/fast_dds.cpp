// A caller of services on Fast DDS as it comes, in the manner of rmw_fastrtps: which sample it calls by stands beside the call.
//
//   fast_dds DOMAIN SERVICE TYPE REQUEST CALLS
//
// REQUEST: bytes of the request after its head, as hex. Each call is of a new client, and leaves as soon as both sides are matched.
// One line for each answer: seconds and bytes; "none" after 10 s.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/common/WriteParams.h>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using Bytes = std::vector<unsigned char>;
using Clock = std::chrono::steady_clock;

// Any message as its bytes.
struct Raw : TopicDataType {
    explicit Raw(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 1 << 20;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = static_cast<uint32_t>(bytes.size());
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

template <class Qos>
Qos reliable(Qos qos) {
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 10;
    qos.endpoint().history_memory_policy = PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return qos;
}

double seconds(Clock::time_point since) { return std::chrono::duration<double>(Clock::now() - since).count(); }

void nap() { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }

int main(int, char** argv) {
    const std::string service = argv[2], type = argv[3], hex = argv[4];
    Bytes request{0, 1, 0, 0};
    for (size_t i = 0; i + 1 < hex.size(); i += 2) request.push_back(std::stoi(hex.substr(i, 2), nullptr, 16));
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(std::atoi(argv[1]), PARTICIPANT_QOS_DEFAULT);
    auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    const auto topic = [&](const std::string& name, const std::string& part) {
        TypeSupport support(new Raw(type + part));
        support.register_type(participant);
        return participant->create_topic(name, type + part, TOPIC_QOS_DEFAULT);
    };
    auto* requests = topic("rq" + service + "Request", "_Request_");
    auto* replies = topic("rr" + service + "Reply", "_Response_");
    for (int call = 0; call < std::atoi(argv[5]); ++call) {
        auto* reader = subscriber->create_datareader(replies, reliable(DATAREADER_QOS_DEFAULT));
        auto* writer = publisher->create_datawriter(requests, reliable(DATAWRITER_QOS_DEFAULT));
        PublicationMatchedStatus there;
        SubscriptionMatchedStatus back;
        const auto begun = Clock::now();
        do {
            nap();
            writer->get_publication_matched_status(there);
            reader->get_subscription_matched_status(back);
        } while ((there.current_count == 0 || back.current_count == 0) && seconds(begun) < 20);
        WriteParams parameters;
        parameters.related_sample_identity().writer_guid() = reader->guid();
        const auto called = Clock::now();
        writer->write(&request, parameters);
        Bytes answer;
        SampleInfo info;
        bool answered = false;
        while (!answered && seconds(called) < 10) {
            answered = reader->take_next_sample(&answer, &info) == ReturnCode_t::RETCODE_OK && info.valid_data;
            if (!answered) nap();
        }
        if (answered) {
            std::printf("%.4f %zu\n", seconds(called), answer.size());
        } else {
            std::puts("none");
        }
        publisher->delete_datawriter(writer);
        subscriber->delete_datareader(reader);
    }
    std::fflush(stdout);
    std::_Exit(0);
}
