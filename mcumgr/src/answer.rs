//! Answers to the requests of tools.

use super::cbor::Writer;
use super::{BUFFER, Clock, HEAD, Head, IMAGE, OS, Sha256, Text};
use heapless::String;

/// The answer to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(
    clippy::large_enum_variant,
    reason = "only one answer is stored at a time, in static memory, so boxing a variant would save nothing"
)]
pub enum Answer {
    /// The request was executed.
    Done,
    /// The text of an echo.
    Echo(Text),
    /// The length of the longest message that is accepted, and the number of messages that can wait.
    Parameters,
    /// The wall clock.
    Time(Clock),
    /// The running image and the one that was received.
    Images([Option<ImageState>; 2]),
    /// The offset in the file that is expected next, bytes.
    Offset(u32),
    /// The request was not executed.
    Failed(Failure),
}

/// The state of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageState {
    /// The version of the image.
    pub version: String<16>,
    /// The SHA-256 that names the image: that of its file without the trailer.
    pub sha256: Sha256,
    /// The image runs from the next start on.
    pub is_pending: bool,
    /// The image remains after the next start.
    pub is_confirmed: bool,
}

/// Why a request was not executed. A failure has a code that all groups share, which is the only one in version 0 of the
/// protocol, and may have a code of one group. They are packed into one number, so that the many functions that return it stay
/// short: the code of the group in the bits 0 to 5 (0 for none), the group in the bits 6 and 7, and the shared code above them.
/// The codes of the groups are those of MCUmgr in Zephyr. The shared codes have the meanings that MCUmgr defines, but not always
/// the values into which Zephyr translates the codes of the groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failure(u16);

impl Failure {
    /// The request is malformed.
    pub const INVALID: Self = Self(3 << 8);
    /// The request is too long.
    pub const TOO_LONG: Self = Self(7 << 8);
    /// There is no such command.
    pub const NOT_SUPPORTED: Self = Self(8 << 8);
    /// The wall clock is not set.
    pub const NO_TIME: Self = Self::new(6, OS, 4);
    /// The time is not accepted.
    pub const TIME: Self = Self::new(3, OS, 5);
    /// There is no image with this hash.
    pub const NO_IMAGE: Self = Self::of_image(5, 8);
    /// There is no such slot.
    pub const SLOT: Self = Self::of_image(3, 14);
    /// The request states no offset for the part of the file.
    pub const OFFSET: Self = Self::of_image(3, 20);
    /// The hash has a wrong length.
    pub const HASH: Self = Self::of_image(3, 24);
    /// The image is still on trial, does not run yet, or its confirmation could not be stored.
    pub const NOT_CONFIRMED: Self = Self::of_image(6, 32);
    /// The running image cannot be tested.
    pub const ALREADY_RUNS: Self = Self::of_image(6, 33);

    /// A failure with the code `code` of the group of images, 1 to 63, and the code `common` that all groups share.
    pub const fn of_image(common: u8, code: u8) -> Self {
        Self::new(common, IMAGE, code)
    }

    const fn new(common: u8, group: u16, code: u8) -> Self {
        Self((common as u16) << 8 | group << 6 | code as u16)
    }

    /// The code that all groups share.
    pub const fn common(self) -> u8 {
        (self.0 >> 8) as u8
    }

    /// The group and its code; `None` for a failure that no group defines.
    const fn of_group(self) -> Option<(u16, u16)> {
        let code = self.0 & 0x3f;
        if code > 0 { Some((self.0 >> 6 & 3, code)) } else { None }
    }
}

impl Answer {
    /// Encodes the answer to the request with this head. Returns the used part of `buffer`; `None` if the buffer is too short,
    /// which cannot happen with [`super::line::MAX_WRAPPED`] bytes.
    // Not inlined, because the caller may be compiled for speed.
    #[inline(never)]
    pub fn encode<'b>(&self, request: &Head, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let (head, body) = buffer.split_first_chunk_mut::<HEAD>()?;
        let mut body = Writer::new(body);
        self.encode_body(request, &mut body);
        let len = body.len;
        let [len_high, len_low] = (len as u16).to_be_bytes();
        let [group_high, group_low] = request.group.to_be_bytes();
        // Operations of SMP: 1 is the answer to a read request, 3 the answer to a write request.
        let version_and_operation = request.version << 3 | if request.is_write { 3 } else { 1 };
        let (sequence, command) = (request.sequence, request.command);
        *head = [version_and_operation, 0, len_high, len_low, group_high, group_low, sequence, command];
        buffer.get(..HEAD + len)
    }

    fn encode_body(&self, request: &Head, body: &mut Writer) {
        let number = |body: &mut Writer, name: &str, number: u32| {
            body.text(name);
            body.number(number);
        };
        match self {
            Self::Done => body.map(0),
            Self::Echo(text) => {
                body.map(1);
                body.text("r");
                body.text(text);
            }
            Self::Parameters => {
                body.map(2);
                number(body, "buf_size", BUFFER.into());
                number(body, "buf_count", 1);
            }
            Self::Time(clock) => {
                body.map(1);
                body.text("datetime");
                body.text(&clock.text());
            }
            Self::Offset(offset) => {
                body.map(1);
                number(body, "off", *offset);
            }
            Self::Images(images) => {
                body.map(1);
                body.text("images");
                body.array(images.iter().flatten().count() as u32);
                for (slot, image) in (0..).zip(images) {
                    if let Some(image) = image {
                        image.encode(slot, body);
                    }
                }
            }
            Self::Failed(failure) => match failure.of_group() {
                Some((group, code)) if request.version > 0 => {
                    body.map(1);
                    body.text("err");
                    body.map(2);
                    number(body, "group", group.into());
                    number(body, "rc", code.into());
                }
                _ => {
                    body.map(1);
                    number(body, "rc", failure.common().into());
                }
            },
        }
    }
}

impl ImageState {
    /// Encodes the state of the image in slot 0, which runs, or 1.
    fn encode(&self, slot: u32, body: &mut Writer) {
        body.map(8);
        body.text("slot");
        body.number(slot);
        body.text("version");
        body.text(&self.version);
        body.text("hash");
        body.bytes(&self.sha256);
        let states = [
            ("bootable", true),
            ("pending", self.is_pending),
            ("confirmed", self.is_confirmed),
            ("active", slot == 0),
            ("permanent", false),
        ];
        for (name, state) in states {
            body.text(name);
            body.flag(state);
        }
    }
}
