//! Counts the bytes on the heap.
#![expect(unsafe_code, reason = "an allocator is unsafe by its trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicIsize, Ordering};

/// The system's allocator. Counts only inside [`live_bytes`], so that it costs the other benches nothing.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static IS_ON: AtomicBool = AtomicBool::new(false);
static N_BYTES: AtomicIsize = AtomicIsize::new(0);

fn count(n_added: usize, n_removed: usize) {
    if IS_ON.load(Ordering::Relaxed) {
        N_BYTES.fetch_add(n_added.cast_signed() - n_removed.cast_signed(), Ordering::Relaxed);
    }
}

// SAFETY: every call goes on to `System` with the arguments it was given; counting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller's obligations are those of `System`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller's obligations are those of `System`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, n_bytes: usize) -> *mut u8 {
        count(n_bytes, layout.size());
        // SAFETY: the caller's obligations are those of `System`.
        unsafe { System.realloc(place, layout, n_bytes) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: the caller's obligations are those of `System`.
        unsafe { System.dealloc(place, layout) }
    }
}

/// What `make` gives, and how many bytes of the heap it holds. Nothing else may run meanwhile.
pub(crate) fn live_bytes<R>(make: impl FnOnce() -> R) -> (R, f64) {
    N_BYTES.store(0, Ordering::Relaxed);
    IS_ON.store(true, Ordering::Relaxed);
    let made = make();
    IS_ON.store(false, Ordering::Relaxed);
    (made, N_BYTES.load(Ordering::Relaxed) as f64)
}
