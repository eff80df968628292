// Aligned memory of workspaces, reused by each thread.
#pragma once
#include <cstddef>
#include <new>
#include <utility>
#include <vector>

namespace jld {

// Workspaces of one thread that are not in use. The heap would split a freed aligned workspace for small objects and
// could not reuse it: a proof grew by 10 MB/s.
struct WorkspacePool {
    static constexpr size_t MOST = size_t(1) << 26, MANY = 512;
    std::vector<std::pair<size_t, void*>> kept;
    size_t bytes = 0;

    WorkspacePool() { kept.reserve(MANY); }
    ~WorkspacePool() {
        for (auto& one : kept) ::operator delete(one.second, std::align_val_t(64));
    }
    void* take(size_t size) {
        for (size_t k = kept.size(); k-- > 0;)
            if (kept[k].first == size) {
                void* found = kept[k].second;
                kept[k] = kept.back(), kept.pop_back(), bytes -= size;
                return found;
            }
        return ::operator new(size, std::align_val_t(64));
    }
    void give(void* place, size_t size) {
        if (kept.size() >= MANY || bytes + size > MOST) return ::operator delete(place, std::align_val_t(64));
        kept.emplace_back(size, place), bytes += size;
    }
};
inline WorkspacePool& workspace_pool() {
    static thread_local WorkspacePool own;
    return own;
}

template <class T>
struct Aligned {
    typedef T value_type;
    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}
    T* allocate(size_t n) { return static_cast<T*>(workspace_pool().take(n * sizeof(T))); }
    void deallocate(T* p, size_t n) { workspace_pool().give(p, n * sizeof(T)); }
    bool operator==(const Aligned&) const { return true; }
    bool operator!=(const Aligned&) const { return false; }
};
template <class T>
using Store = std::vector<T, Aligned<T>>;

}  // namespace jld
