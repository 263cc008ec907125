/* Stands between a program and the disk: records what is written, or lets a write fail.
 *
 * Loaded with LD_PRELOAD. FAULTY_ROOT: only files below this folder. FAULTY_LOG: record every change there,
 * in order, as   kind u8 | path length u16 | path | offset i64 | length i64 | data.
 * Kinds: W write, T truncate, B sync begins, E sync ended well, U unlink, R rename (data: new name).
 * faulty_arm(n, error, how, ms): from the n-th change on changes fail with errno `error`, for so many
 * milliseconds, 0 for ever. `how` is WRITES: all changes; HALVES: writes take half of their bytes before they
 * fail; SYNCS: only syncs; GONE: files cannot be opened nor read either. faulty_count() counts the changes.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int log_fd = -1;
enum { WRITES, HALVES, SYNCS, GONE };
static long changes, fail_at, fail_error, fail_how, fail_ms, failing_since;

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

static ssize_t raw_write(int fd, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    return real(fd, data, size);
}

void faulty_arm(long n, long error, long how, long ms) {
    changes = failing_since = 0; fail_at = n; fail_error = error; fail_how = how; fail_ms = ms;
}

/* FAULTY_FAIL: the four numbers of faulty_arm, for a program that is armed from its beginning. */
__attribute__((constructor)) static void arm_at_once(void) {
    long n, error, how, ms;
    const char *numbers = getenv("FAULTY_FAIL");
    if (numbers && sscanf(numbers, "%ld %ld %ld %ld", &n, &error, &how, &ms) == 4) faulty_arm(n, error, how, ms);
}

long faulty_count(void) { return changes; }

static int below_root(const char *path) {
    const char *root = getenv("FAULTY_ROOT");
    size_t size = root ? strlen(root) : 0;
    return size && strncmp(path, root, size) == 0 && !strstr(path, "-shm");
}

static int path_of(int fd, char *path) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t size = readlink(link, path, PATH_MAX - 1);
    if (size < 0) return 0;
    path[size] = 0;
    return below_root(path);
}

static void record(char kind, const char *path, int64_t offset, const void *data, int64_t size) {
    const char *name = getenv("FAULTY_LOG");
    if (!name) return;
    if (log_fd < 0) log_fd = open(name, O_WRONLY | O_CREAT | O_APPEND, 0644);
    uint16_t length = strlen(path);
    raw_write(log_fd, &kind, 1);
    raw_write(log_fd, &length, 2);
    raw_write(log_fd, path, length);
    raw_write(log_fd, &offset, 8);
    raw_write(log_fd, &size, 8);
    if (data) raw_write(log_fd, data, size);
}

static long now_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* Whether the disk fails now. */
static int is_failing(void) {
    return failing_since && (!fail_ms || now_ms() < failing_since + fail_ms);
}

/* Whether this change shall fail; counts it. */
static int fails(int is_sync) {
    if (++changes == fail_at) failing_since = now_ms();
    return is_failing() && (is_sync || fail_how != SYNCS);
}

/* Whether opening or reading shall fail, of a disk that is gone. */
static int is_gone(void) { return fail_how == GONE && is_failing(); }

static ssize_t put(int fd, const void *data, size_t size, off_t offset, int positioned) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off_t);
    char path[PATH_MAX];
    if (!path_of(fd, path)) return positioned ? real(fd, data, size, offset) : raw_write(fd, data, size);
    pthread_mutex_lock(&lock);
    if (!positioned) offset = lseek(fd, 0, SEEK_CUR);
    ssize_t done = -1;
    int failing = fails(0);
    if (failing && (fail_how != HALVES || size < 2)) {
        errno = fail_error;
    } else {
        if (failing) size /= 2;
        done = positioned ? real(fd, data, size, offset) : raw_write(fd, data, size);
        int saved = errno;
        if (done > 0) record('W', path, offset, data, done);
        errno = saved;
    }
    pthread_mutex_unlock(&lock);
    return done;
}

ssize_t write(int fd, const void *data, size_t size) { return put(fd, data, size, 0, 0); }
ssize_t pwrite(int fd, const void *data, size_t size, off_t offset) { return put(fd, data, size, offset, 1); }
ssize_t pwrite64(int fd, const void *data, size_t size, off_t offset) { return put(fd, data, size, offset, 1); }

ssize_t writev(int fd, const struct iovec *parts, int count) {
    char path[PATH_MAX];
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    if (!path_of(fd, path)) return real(fd, parts, count);
    ssize_t total = 0;
    for (int i = 0; i < count; i++) {
        ssize_t done = put(fd, parts[i].iov_base, parts[i].iov_len, 0, 0);
        if (done < 0) return total ? total : -1;
        total += done;
        if ((size_t)done < parts[i].iov_len) break;
    }
    return total;
}

static int cut(int fd, off_t size) {
    REAL(int, "ftruncate64", int, off_t);
    char path[PATH_MAX];
    if (!path_of(fd, path)) return real(fd, size);
    pthread_mutex_lock(&lock);
    int done = -1;
    if (fails(0)) errno = fail_error;
    else if ((done = real(fd, size)) == 0) record('T', path, size, NULL, 0);
    pthread_mutex_unlock(&lock);
    return done;
}

int ftruncate(int fd, off_t size) { return cut(fd, size); }
int ftruncate64(int fd, off_t size) { return cut(fd, size); }

static int keep(int fd, const char *name) {
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, name);
    char path[PATH_MAX];
    if (!path_of(fd, path)) return real(fd);
    pthread_mutex_lock(&lock);
    int failing = fails(1);
    record('B', path, 0, NULL, 0);
    pthread_mutex_unlock(&lock);
    if (failing) { errno = fail_error == ENOSPC ? EIO : fail_error; return -1; }
    int done = real(fd);
    pthread_mutex_lock(&lock);
    if (done == 0) record('E', path, 0, NULL, 0);
    pthread_mutex_unlock(&lock);
    return done;
}

int fsync(int fd) { return keep(fd, "fsync"); }
int fdatasync(int fd) { return keep(fd, "fdatasync"); }

int unlink(const char *path) {
    REAL(int, "unlink", const char *);
    if (!below_root(path)) return real(path);
    pthread_mutex_lock(&lock);
    int done = -1;
    if (fails(0)) errno = fail_error;
    else if ((done = real(path)) == 0) record('U', path, 0, NULL, 0);
    pthread_mutex_unlock(&lock);
    return done;
}

int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    if (!below_root(from)) return real(from, to);
    pthread_mutex_lock(&lock);
    int done = -1;
    if (fails(0)) errno = fail_error;
    else if ((done = real(from, to)) == 0) record('R', from, 0, to, strlen(to));
    pthread_mutex_unlock(&lock);
    return done;
}

int open64(const char *path, int flags, ...) {
    REAL(int, "open64", const char *, int, ...);
    va_list more;
    va_start(more, flags);
    int mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, int) : 0;
    va_end(more);
    if (below_root(path)) {
        pthread_mutex_lock(&lock);
        int failing = flags & (O_CREAT | O_TRUNC) ? fails(0) : is_gone();
        pthread_mutex_unlock(&lock);
        if (failing) { errno = fail_error; return -1; }
    }
    return real(path, flags, mode);
}

ssize_t sendfile64(int to, int from, off_t *offset, size_t size) {
    REAL(ssize_t, "sendfile64", int, int, off_t *, size_t);
    char path[PATH_MAX];
    if (!path_of(to, path)) return real(to, from, offset, size);
    pthread_mutex_lock(&lock);
    int failing = fails(0);
    pthread_mutex_unlock(&lock);
    if (failing) { errno = fail_error; return -1; }
    return real(to, from, offset, size);
}

ssize_t pread64(int fd, void *data, size_t size, off_t offset) {
    REAL(ssize_t, "pread64", int, void *, size_t, off_t);
    char path[PATH_MAX];
    if (is_gone() && path_of(fd, path)) { errno = fail_error; return -1; }
    return real(fd, data, size, offset);
}

ssize_t read(int fd, void *data, size_t size) {
    REAL(ssize_t, "read", int, void *, size_t);
    char path[PATH_MAX];
    if (is_gone() && path_of(fd, path)) { errno = fail_error; return -1; }
    return real(fd, data, size);
}

int stat64(const char *path, struct stat64 *about) {
    REAL(int, "stat64", const char *, struct stat64 *);
    if (is_gone() && below_root(path)) { errno = fail_error; return -1; }
    return real(path, about);
}
