//! Memory held against the size of the input: libFuzzer's own limit (`-rss_limit_mb`) is one number for all inputs.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, which adds up what each thread holds.
struct Counting;

thread_local! {
    static HELD_BYTES: Cell<isize> = const { Cell::new(0) };
    static PEAK_BYTES: Cell<isize> = const { Cell::new(0) };
}

fn add(bytes: isize) {
    // A thread that ends may free after its cells are gone.
    let _ = HELD_BYTES.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = PEAK_BYTES.try_with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: every call goes to the system's allocator with what it was given.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        add(-(layout.size() as isize));
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Runs `work`, and ends the process when it held more than `fixed_bytes` and `per_byte` times the input at once.
pub fn bounded<T>(
    input_bytes: usize,
    fixed_bytes: usize,
    per_byte: usize,
    work: impl FnOnce() -> T,
) -> T {
    let before = HELD_BYTES.get();
    PEAK_BYTES.set(before);
    let done = work();
    let peak_bytes = (PEAK_BYTES.get() - before).max(0) as usize;
    let most = fixed_bytes + per_byte * input_bytes;
    assert!(
        peak_bytes <= most,
        "{peak_bytes} bytes held for an input of {input_bytes}; at most {most}"
    );
    done
}
