"""
Owns shared memory on Linux: a file under /dev/shm, its lock, its mappings, and sleeping on a word of it.

The owner holds a POSIX record lock on the file: it ends with its process, however that ends, and a forked
child does not get it. Such a lock is lost when its process closes any descriptor of the file; so an owner's
file is opened once, and readers in the same process use the owner's descriptor.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memcpy

from tf2_py._internal cimport (
    ABOUT_AT,
    BOARD_AT,
    Board,
    Segment,
    SharedMemory,
    SharingEngine,
    segment_is_ready,
)

import errno as errors
import fcntl
import os
import stat
import threading
import time
import weakref
import zlib
from pathlib import Path

cdef extern from *:
    """
    #include <errno.h>
    #include <fcntl.h>
    #include <linux/futex.h>
    #include <signal.h>
    #include <stdint.h>
    #include <sys/mman.h>
    #include <sys/stat.h>
    #include <sys/syscall.h>
    #include <time.h>
    #include <unistd.h>

    #define TF2_MAPPINGS 2048

    /* Where segments are mapped. Only the handler reads it without the GIL. */
    static struct {
        char *volatile base;
        size_t size;
        volatile int *lost;
    } tf2_mappings[TF2_MAPPINGS];
    static struct sigaction tf2_before;     /* whose place the handler took last ... */
    static struct sigaction tf2_first;      /* ... and whose it took first */
    static int tf2_watches;

    /* A file that was truncated has no memory behind its end. Zeros take the place of all of it: whoever
       reads them finds out, and goes on without. */
    static void tf2_on_bus_error(int number, siginfo_t *information, void *context)
    {
        char *at = information->si_addr;
        for (int i = 0; i < TF2_MAPPINGS; ++i) {
            char *base = tf2_mappings[i].base;
            if (base && at >= base && at < base + tf2_mappings[i].size) {
                int saved = errno;
                void *made = mmap(base, tf2_mappings[i].size, PROT_READ | PROT_WRITE,
                                  MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0);
                errno = saved;
                if (made == base) {
                    *tf2_mappings[i].lost = 1;
                    return;
                }
            }
        }
        /* What came between the first time and the last may pass a signal on to this handler, by raising it
           again, as Python's faulthandler does: it must not get that one back. */
        const struct sigaction *next = information->si_code > 0 ? &tf2_before : &tf2_first;
        if (next->sa_flags & SA_SIGINFO)
            next->sa_sigaction(number, information, context);
        else if (next->sa_handler != SIG_DFL && next->sa_handler != SIG_IGN)
            next->sa_handler(number);
        else {
            sigaction(number, next, NULL);  /* it happens again, and ends the process */
            if (information->si_code <= 0)
                raise(number);              /* of itself it would not */
        }
    }

    static void tf2_watch_bus_errors(void)
    {
        struct sigaction now, action = {.sa_sigaction = tf2_on_bus_error, .sa_flags = SA_SIGINFO};
        sigemptyset(&action.sa_mask);
        if (sigaction(SIGBUS, NULL, &now) == 0 && now.sa_sigaction != tf2_on_bus_error) {
            tf2_before = now;
            if (!tf2_watches)
                tf2_first = now;
            tf2_watches = 1;
            sigaction(SIGBUS, &action, NULL);
        }
    }

    static int tf2_register(char *base, size_t size, volatile int *lost)
    {
        for (int i = 0; i < TF2_MAPPINGS; ++i)
            if (!tf2_mappings[i].base) {
                tf2_mappings[i].size = size;
                tf2_mappings[i].lost = lost;
                tf2_mappings[i].base = base;
                tf2_watch_bus_errors();
                return 0;
            }
        return -1;
    }

    static void tf2_unregister(char *base)
    {
        for (int i = 0; i < TF2_MAPPINGS; ++i)
            if (tf2_mappings[i].base == base)
                tf2_mappings[i].base = NULL;
    }

    static void *tf2_map(int descriptor, size_t start, size_t size, int writable)
    {
        void *made = mmap(NULL, size, PROT_READ | (writable ? PROT_WRITE : 0), MAP_SHARED | MAP_NORESERVE,
                          descriptor, (off_t)start);
        if (made == MAP_FAILED)
            return NULL;
        madvise(made, size, MADV_DONTDUMP);
        return made;
    }

    static int tf2_commit(int descriptor, size_t start, size_t size)
    {
        int result;
        do
            result = posix_fallocate(descriptor, (off_t)start, (off_t)size);
        while (result == EINTR);
        return result ? -1 : 0;
    }

    static int tf2_lock(int descriptor)
    {
        struct flock all = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
        return fcntl(descriptor, F_SETLK, &all);
    }

    /* The process that holds the lock; 0: none does, but for this one; -1: it could not be asked. */
    static long tf2_holder(int descriptor)
    {
        struct flock all = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
        if (fcntl(descriptor, F_GETLK, &all) != 0)
            return -1;
        return all.l_type == F_UNLCK ? 0 : all.l_pid > 0 ? all.l_pid : -1;
    }

    static int tf2_is_locked(int descriptor)
    {
        struct flock all = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
        return fcntl(descriptor, F_GETLK, &all) != 0 || all.l_type != F_UNLCK;
    }

    static size_t tf2_file_size(int descriptor)
    {
        struct stat facts;
        return fstat(descriptor, &facts) == 0 ? (size_t)facts.st_size : 0;
    }

    static int tf2_is_at(const char *path, int descriptor)
    {
        struct stat there, open;
        return lstat(path, &there) == 0 && fstat(descriptor, &open) == 0 && there.st_dev == open.st_dev
            && there.st_ino == open.st_ino;
    }

    static void tf2_futex_wake(const void *word)
    {
        syscall(SYS_futex, word, FUTEX_WAKE, 0x7fffffff, NULL, NULL, 0);
    }

    static void tf2_futex_wait(const void *word, uint32_t seen, int64_t ns)
    {
        struct timespec duration = {.tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000};
        syscall(SYS_futex, word, FUTEX_WAIT, seen, &duration, NULL, 0);
    }
    """
    ctypedef int volatile_int "volatile int"
    int bus_register "tf2_register"(char* base, size_t size, volatile_int* lost) nogil
    void bus_unregister "tf2_unregister"(char* base) nogil
    void* map_file "tf2_map"(int descriptor, size_t start, size_t size, bint writable) nogil
    int munmap(void* start, size_t size) nogil
    int commit_file "tf2_commit"(int descriptor, size_t start, size_t size) nogil
    int lock_file "tf2_lock"(int descriptor) nogil
    long lock_holder "tf2_holder"(int descriptor) nogil
    bint file_is_locked "tf2_is_locked"(int descriptor) nogil
    size_t file_size "tf2_file_size"(int descriptor) nogil
    void futex_wake "tf2_futex_wake"(const void* word) nogil
    void futex_wait "tf2_futex_wait"(const void* word, uint32_t seen, int64_t ns) nogil
    long getpid() nogil
    bint file_is_at "tf2_is_at"(const char* path, int descriptor) nogil     # whether the path leads to it
    int close_file "close"(int descriptor) nogil
    int unlink_file "unlink"(const char* path) nogil

cdef enum:
    PAGE_BYTES = 4096
    ABOUT_BYTES = 3064          # of the text; before it its size and checksum, four bytes each

# Address space, of which only what is used becomes memory. Less where the process may not have so much.
cdef tuple SIZES = (1 << 36, 1 << 34, 1 << 32, 1 << 30, 1 << 28)
cdef double BEGIN_S = 0.5                   # so long an owner may take to prepare its file

# The owners of this process, by device and inode of their files.
_owned = weakref.WeakValueDictionary()
# Held while a file is looked at and then locked, removed or closed: a record lock excludes no thread of the
# process that has it, and is lost when any of them closes the file.
_files = threading.RLock()


cdef struct Place:
    # The file of a segment, as its functions need it.
    int descriptor              # of the file; -1: closed
    volatile_int lost           # the file was truncated
    long owner_process          # of an owner in this process, the process's id; otherwise 0
    bint* is_owned        # and whether it is one still


cdef bint _is_alive(Segment* segment) noexcept nogil:
    cdef Place* place = <Place*>segment.place
    if place.lost or place.descriptor < 0:
        return False
    if place.owner_process == getpid():
        return place.is_owned[0]
    return file_is_locked(place.descriptor) and file_size(place.descriptor) == segment.size


cdef int _commit(Segment* segment, size_t start, size_t size) noexcept nogil:
    cdef Place* place = <Place*>segment.place
    return -1 if place.lost else commit_file(place.descriptor, start, size)


cdef void _wake(const uint32_t* word) noexcept nogil:
    futex_wake(word)


cdef void _sleep(const uint32_t* word, uint32_t seen, int64_t ns) noexcept nogil:
    futex_wait(word, seen, ns)


@cython.no_gc_clear
cdef class _Mapping(SharedMemory):
    # A file that is mapped.
    cdef Place _place
    cdef bint _board_is_apart   # the board is mapped by itself
    cdef bytes _path            # which the collector cannot clear: __dealloc__ needs it

    def __cinit__(self, path):
        self._path = os.fsencode(path)
        self._place.descriptor = -1
        self.segment.place = &self._place
        self.segment.commit = _commit
        self.segment.wake = _wake
        self.segment.sleep = _sleep
        self.segment.is_alive = _is_alive

    def __dealloc__(self):
        if self.segment.base != NULL:
            bus_unregister(self.segment.base)
            munmap(self.segment.base, self.segment.size)
        if self._board_is_apart:
            bus_unregister(<char*>self.segment.board)
            munmap(self.segment.board, PAGE_BYTES)

    @property
    def path(self):
        """The file."""
        return Path(os.fsdecode(self._path))

    @property
    def owner(self):
        """The id of the owner's process, as far as it is seen here; 0: there is none any more."""
        if self._place.owner_process == getpid():
            return os.getpid()
        return max(0, lock_holder(self._place.descriptor))

    @property
    def is_alive(self):
        """Whether the owner lives."""
        return bool(_is_alive(&self.segment))

    def description(self):
        """What the owner has told about itself; ``b""``: nothing that can be read."""
        cdef uint32_t numbers[2]
        for _ in range(100):
            memcpy(numbers, self.segment.base + ABOUT_AT, 8)
            if numbers[0] > ABOUT_BYTES:
                break
            text = <bytes>(self.segment.base + ABOUT_AT + 8)[:numbers[0]]
            if zlib.crc32(text) == numbers[1]:
                return text
            time.sleep(0.001)
        return b""

    cdef bint _map(self, size_t size, bint writable) except -1:
        # False: there is not so much address space.
        cdef char* base = <char*>map_file(self._place.descriptor, 0, size, writable)
        cdef char* board = base
        if base == NULL:
            return False
        if bus_register(base, size, &self._place.lost) != 0:
            munmap(base, size)
            raise OSError(errors.EMFILE, "this process has too many of them")
        self.segment.base = base
        self.segment.size = size
        if not writable:
            board = <char*>map_file(self._place.descriptor, BOARD_AT, PAGE_BYTES, True)
            if board == NULL:
                return False
            self._board_is_apart = True
            self.segment.board = <Board*>board
            if bus_register(board, PAGE_BYTES, &self._place.lost) != 0:
                raise OSError(errors.EMFILE, "this process has too many of them")
        else:
            self.segment.board = <Board*>(base + BOARD_AT)
        return True


def _identity(facts):
    """Of a file, whatever its name."""
    return facts.st_dev, facts.st_ino


def _open(path, flags):
    descriptor = _above_standard(os.open(path, flags | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600))
    facts = os.fstat(descriptor)
    if not stat.S_ISREG(facts.st_mode) or facts.st_uid != os.geteuid():
        os.close(descriptor)
        raise PermissionError(errors.EPERM, "it is not this user's")
    if facts.st_mode & 0o077:
        os.close(descriptor)
        raise PermissionError(errors.EPERM, "other users may open it")
    return descriptor


def _above_standard(descriptor):
    # Where a standard stream is closed, a file gets its number, and whatever is logged is written to it.
    if descriptor > 2:
        return descriptor
    try:
        return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    finally:
        os.close(descriptor)


def _owner_here(path):
    """The segment of this path that this process owns, or None."""
    try:
        return _owned.get(_identity(os.stat(path, follow_symlinks=False)))
    except FileNotFoundError:
        return None


@cython.no_gc_clear
cdef class OwnedSegment(_Mapping):
    """
    A new segment, of which this process is the owner until :meth:`close`.

    :param path: of its file. One that a dead owner has left there is replaced.
    :raises BlockingIOError: another process owns the file, or this one does; ``args[0]`` is its id.
    :raises OSError: it cannot be made.
    """

    cdef bint _is_owned
    cdef object __weakref__

    def __init__(self, path):
        until = time.monotonic() + BEGIN_S
        while not self._try_to_own(until):
            time.sleep(0.005)
        try:
            for size in SIZES:
                try:
                    os.ftruncate(self._place.descriptor, size)
                except OSError as error:
                    if error.errno not in (errors.EFBIG, errors.EINVAL):
                        raise
                    continue
                if self._map(size, True):
                    break
            else:
                raise OSError(errors.ENOMEM, "there is no address space for it")
        except BaseException:
            self.close()
            raise

    cdef bint _try_to_own(self, double until) except -1:
        # An owner's file is never used again: those who follow the dead one still read it.
        with _files:
            while True:
                if _owner_here(self._path) is not None:
                    raise BlockingIOError(os.getpid())
                descriptor = _open(self._path, os.O_CREAT)
                if lock_file(descriptor) != 0:
                    holder = lock_holder(descriptor)
                    os.close(descriptor)
                    # It may be one that removes what a dead owner has left.
                    if time.monotonic() > until:
                        raise BlockingIOError(holder)
                    return False
                if not file_is_at(self._path, descriptor):
                    os.close(descriptor)
                elif os.fstat(descriptor).st_size:
                    os.unlink(self._path)
                    os.close(descriptor)
                else:
                    self._place.descriptor = descriptor
                    self._place.is_owned = &self._is_owned
                    self._place.owner_process = getpid()
                    self._is_owned = True
                    _owned[_identity(os.fstat(descriptor))] = self
                    return True

    def __dealloc__(self):
        self._close()

    def publish(self, SharingEngine buffer not None):
        """Let it hold what this buffer holds."""
        buffer._share(self)

    def describe(self, bytes text not None):
        """Tell readers this about the owner: 3 kB at most."""
        cdef uint32_t numbers[2]
        if len(text) > ABOUT_BYTES:
            raise ValueError(f"a description has {ABOUT_BYTES} bytes at most, not {len(text)}")
        numbers[0] = len(text)
        numbers[1] = zlib.crc32(text)
        memcpy(self.segment.base + ABOUT_AT + 8, <const char*>text, len(text))
        memcpy(self.segment.base + ABOUT_AT, numbers, 8)

    def unlink(self):
        """Remove the file: nobody else finds it. Its readers stay, until this process ends."""
        with _files:
            self._unlink()

    def close(self):
        """End being its owner: readers leave. The memory stays until the last of them has done so."""
        with _files:
            self._close()

    # In C alone, for __dealloc__: at the end of the interpreter there are no modules.

    cdef void _unlink(self):
        if (self._place.descriptor >= 0 and self._is_owned
                and self._place.owner_process == getpid()
                and file_is_at(self._path, self._place.descriptor)):
            unlink_file(self._path)

    cdef void _close(self):
        if self._place.descriptor >= 0:
            self._unlink()
            close_file(self._place.descriptor)
            self._place.descriptor = -1
            self._is_owned = False


@cython.no_gc_clear
cdef class FollowedSegment(_Mapping):
    """
    The segment of another owner, mapped for reading.

    :param path: of its file.
    :raises FileNotFoundError: there is none, or its owner has died; the file is then removed.
    :raises OSError: it cannot be read.
    :raises ValueError: it is no segment.
    """

    cdef OwnedSegment _owner_here

    def __init__(self, path):
        cdef size_t size
        until = time.monotonic() + BEGIN_S
        with _files:
            self._owner_here = _owner_here(path)
            if self._owner_here is not None:
                self._place = self._owner_here._place
            else:
                self._place.descriptor = _open(path, 0)
                if not file_is_locked(self._place.descriptor):
                    remove_dead(path)
                    raise FileNotFoundError(errors.ENOENT, "its owner has died", str(path))
        while True:
            size = file_size(self._place.descriptor)
            if size > ABOUT_AT:
                if self.segment.base == NULL and not self._map(size, False):
                    raise OSError(errors.ENOMEM, "there is no address space for it")
                if segment_is_ready(&self.segment):
                    break
            if time.monotonic() > until:
                raise ValueError("it is no shared buffer")
            time.sleep(0.002)

    def __dealloc__(self):
        if self._owner_here is None and self._place.descriptor >= 0:
            close_file(self._place.descriptor)

    def attach(self, SharingEngine buffer not None):
        """Let this buffer hold what the owner's holds."""
        buffer._attach(self)


def remove_dead(path):
    """
    Remove the file of an owner that has died.

    :return: whether there was one.
    """
    with _files:
        if _owner_here(path) is not None:
            return False
        try:
            descriptor = _open(path, 0)
        except OSError:
            return False
        try:
            # One that is empty is being prepared.
            if os.fstat(descriptor).st_size == 0 or lock_file(descriptor) != 0:
                return False
            if not file_is_at(os.fsencode(path), descriptor):
                return False
            os.unlink(path)
            return True
        finally:
            os.close(descriptor)


def _after_fork_in_child():
    # A forked child owns nothing, and another thread may have held the lock.
    global _files
    _files = threading.RLock()
    _owned.clear()


os.register_at_fork(after_in_child=_after_fork_in_child)
