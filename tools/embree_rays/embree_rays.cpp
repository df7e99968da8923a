// Times Embree 3 (robust mode) on a mesh and rays written by `ours.rs`. Benchmark only; no part of glowtree links to it.
#include <embree3/rtcore.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <vector>

struct Segment { float o[3], t_min, d[3], t_max; };

static double cpu_seconds(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static std::vector<char> slurp(const std::string& name) {
    FILE* file = std::fopen(name.c_str(), "rb");
    if (!file) { std::perror(name.c_str()); std::exit(1); }
    std::fseek(file, 0, SEEK_END);
    std::vector<char> bytes(std::ftell(file));
    std::rewind(file);
    if (std::fread(bytes.data(), 1, bytes.size(), file) != bytes.size()) std::exit(1);
    std::fclose(file);
    return bytes;
}

template <class Query>
static void report(const char* name, const std::vector<char>& bytes, Query query) {
    const Segment* rays = reinterpret_cast<const Segment*>(bytes.data());
    const size_t count = bytes.size() / sizeof(Segment);
    double best = INFINITY;
    size_t hits = 0;
    for (int sweep = 0; sweep < 5; ++sweep) {
        const double start = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
        hits = 0;
        for (size_t i = 0; i < count; ++i) hits += query(rays[i]);
        best = std::fmin(best, cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - start);
    }
    std::printf("%-11s%.3f Mray/s  hits %.5f\n", name, count / best * 1e-6, double(hits) / count);
}

static void fill(RTCRay& to, const Segment& from) {
    to.org_x = from.o[0]; to.org_y = from.o[1]; to.org_z = from.o[2]; to.tnear = from.t_min;
    to.dir_x = from.d[0]; to.dir_y = from.d[1]; to.dir_z = from.d[2]; to.tfar = from.t_max;
    to.time = 0; to.mask = -1u; to.id = 0; to.flags = 0;
}

int main(int argc, char** argv) {
    if (argc < 2) { std::puts("usage: embree_rays DIR [fast]"); return 2; }
    const std::string directory = argv[1];
    const bool robust = argc < 3;
    auto bytes = slurp(directory + "/mesh.bin");
    const uint64_t* counts = reinterpret_cast<const uint64_t*>(bytes.data());
    const float* vertices = reinterpret_cast<const float*>(bytes.data() + 16);
    const uint32_t* triangles = reinterpret_cast<const uint32_t*>(vertices + 3 * counts[0]);

    RTCDevice device = rtcNewDevice("hugepages=1");
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* v = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, counts[0]);
    void* t = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, counts[1]);
    std::copy(vertices, vertices + 3 * counts[0], static_cast<float*>(v));
    std::copy(triangles, triangles + 3 * counts[1], static_cast<uint32_t*>(t));
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    const double start = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID);
    rtcCommitScene(scene);
    const double seconds = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID) - start;
    std::printf("build %.3f CPU s, %.3f us/triangle\n", seconds, seconds * 1e6 / counts[1]);

    auto closest = [&](const Segment& segment) {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        RTCRayHit query;
        fill(query.ray, segment);
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, &context, &query);
        return query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    };
    auto occluded = [&](const Segment& segment) {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        RTCRay query;
        fill(query, segment);
        rtcOccluded1(scene, &context, &query);
        return query.tfar < 0;
    };
    const auto segments = slurp(directory + "/segments.bin");
    const auto hemispheres = slurp(directory + "/hemispheres.bin");
    report("closest", segments, closest);
    report("occlusion", segments, occluded);
    report("hemisphere", hemispheres, closest);
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}
