//! Text that crosses the boundary: lent UTF-8, and the buffer a callee writes its error message into.

#![expect(unsafe_code, reason = "the boundary itself: pointers from the other side are read and written here")]

use core::{ptr, slice, str};

/// UTF-8 text, lent; not terminated by a zero.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Text {
    /// First byte; may be null when `length` is 0.
    pub pointer: *const u8,
    /// How many bytes.
    pub length: usize,
}

// SAFETY: a `Text` in a static points to a `&'static str` (the only safe constructor lends one), which any thread may read;
// elsewhere the pointer is read through an `unsafe fn` whose caller answers for it.
unsafe impl Sync for Text {}

impl Text {
    /// Lends `text`.
    #[must_use]
    pub const fn new(text: &str) -> Self {
        Self { pointer: text.as_ptr(), length: text.len() }
    }

    /// The text; `None` when it is not UTF-8.
    ///
    /// # Safety
    /// 1. `pointer` is null with `length` 0, or points to `length` readable bytes that stay unchanged for `'a`.
    #[must_use]
    pub const unsafe fn as_str<'a>(self) -> Option<&'a str> {
        if self.pointer.is_null() {
            return if self.length == 0 { Some("") } else { None };
        }
        // SAFETY: obligation 1.
        match str::from_utf8(unsafe { slice::from_raw_parts(self.pointer, self.length) }) {
            Ok(text) => Some(text),
            Err(_) => None,
        }
    }
}

/// Where a callee writes why it failed. The caller owns the memory.
#[repr(C)]
#[derive(Debug)]
pub struct ErrorBuffer {
    /// Room for the message.
    pub message: *mut u8,
    /// How many bytes fit.
    pub capacity: usize,
    /// How many bytes were written, UTF-8; 0 when there is no message.
    pub length: usize,
}

impl ErrorBuffer {
    /// Lends `room` to a callee.
    #[must_use]
    pub const fn new(room: &mut [u8]) -> Self {
        Self { message: room.as_mut_ptr(), capacity: room.len(), length: 0 }
    }

    /// Writes as much of `message` as fits, cut between characters.
    ///
    /// # Safety
    /// 1. `self.message` points to `self.capacity` writable bytes, or the capacity is 0.
    pub const unsafe fn write(&mut self, message: &str) {
        let mut length = if message.len() < self.capacity { message.len() } else { self.capacity };
        while !message.is_char_boundary(length) {
            length -= 1;
        }
        if length > 0 {
            // SAFETY: obligation 1, and `length <= capacity`; a caller's buffer cannot overlap a text borrowed here.
            unsafe { ptr::copy_nonoverlapping(message.as_ptr(), self.message, length) };
        }
        self.length = length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(capacity: usize, message: &str, expected: &str) {
        let mut room = [b'#'; 16];
        let mut buffer = ErrorBuffer::new(&mut room[..capacity]);
        // SAFETY: the buffer lends `room`.
        unsafe { buffer.write(message) };
        let length = buffer.length;
        assert_eq!(str::from_utf8(&room[..length]), Ok(expected));
        assert!(room[length..].iter().all(|&byte| byte == b'#'), "bytes beyond the message were touched");
    }

    #[test]
    fn messages_are_cut_between_characters() {
        check(16, "no grid", "no grid");
        check(3, "no grid", "no ");
        check(0, "no grid", "");
        check(2, "aé", "a");
        check(3, "aé", "aé");
    }

    #[test]
    fn text_that_is_not_utf8_is_none() {
        // SAFETY: the bytes and the empty text outlive the calls.
        unsafe {
            assert_eq!(Text::new("grün").as_str(), Some("grün"));
            assert_eq!(Text { pointer: [0xff_u8].as_ptr(), length: 1 }.as_str(), None);
            assert_eq!(Text { pointer: ptr::null(), length: 0 }.as_str(), Some(""));
            assert_eq!(Text { pointer: ptr::null(), length: 9 }.as_str(), None);
        }
    }
}
