//! The part of CBOR (RFC 8949) that the protocol uses. With `minicbor` 2.3 in its place, the firmware of the STM32WB55 was 4,816
//! bytes longer and only 608 bytes below its limit.

// The major types.
const NUMBER: u8 = 0;
const BYTES: u8 = 2;
const TEXT: u8 = 3;
const ARRAY: u8 = 4;
const MAP: u8 = 5;
const TAG: u8 = 6;
const SIMPLE: u8 = 7;
/// The value of the simple item for false; that for true is one higher.
const FALSE: u32 = 20;
/// Stands for the length of a map of indefinite length, and for the value of the item "break" that ends it.
const OPEN: u32 = u32::MAX;

/// A decoded item. For an array, a map or a tag, it is only the head; the items that belong to it follow.
#[derive(Clone, Copy)]
pub(crate) struct Item<'b> {
    /// The major type.
    kind: u8,
    /// The number, or the length.
    value: u32,
    /// The content of bytes and text.
    content: &'b [u8],
}

impl<'b> Item<'b> {
    /// Takes the next item from `rest`; `None` if it is malformed, incomplete or too large.
    fn take(rest: &mut &'b [u8]) -> Option<Self> {
        let (&first, mut after) = rest.split_first()?;
        let (kind, short) = (first >> 5, first & 0x1f);
        let value = match short {
            0..=23 => short.into(),
            24..=27 => {
                let (number, after_number) = after.split_at_checked(1 << (short - 24))?;
                after = after_number;
                let (large, number) = number.split_at(number.len().saturating_sub(4));
                if large.iter().any(|byte| *byte != 0) {
                    return None;
                }
                number.iter().fold(0, |value, byte| value << 8 | u32::from(*byte))
            }
            31 if matches!(kind, MAP | SIMPLE) => OPEN,
            _ => return None,
        };
        let mut content = &[][..];
        if matches!(kind, BYTES | TEXT) {
            (content, after) = after.split_at_checked(value as usize)?;
        }
        *rest = after;
        Some(Self { kind, value, content })
    }

    /// Takes the items that belong to this one from `rest`.
    fn skip(self, rest: &mut &'b [u8]) -> Option<()> {
        let (mut item, mut items_left) = (self, 0_u32);
        loop {
            let inner = match item.kind {
                ARRAY => item.value,
                MAP => item.value.checked_mul(2)?,
                TAG => 1,
                _ => 0,
            };
            items_left = items_left.checked_add(inner)?;
            if items_left == 0 {
                return Some(());
            }
            items_left -= 1;
            item = Self::take(rest)?;
        }
    }

    pub(crate) fn number(self) -> Option<u32> {
        (self.kind == NUMBER).then_some(self.value)
    }

    pub(crate) fn bytes(self) -> Option<&'b [u8]> {
        (self.kind == BYTES).then_some(self.content)
    }

    pub(crate) fn text(self) -> Option<&'b str> {
        (self.kind == TEXT).then(|| core::str::from_utf8(self.content).ok()).flatten()
    }

    pub(crate) fn flag(self) -> Option<bool> {
        (self.kind == SIMPLE && self.value & !1 == FALSE).then_some(self.value > FALSE)
    }
}

/// Reads a map from texts to items. Returns the items with these keys; `None` if the map is malformed, or contains what no known
/// tool sends: a number of more than 32 bits, such as most doubles, or a text, array or inner map of indefinite length.
pub(crate) fn read_map<'b, const N: usize>(mut rest: &'b [u8], keys: &[&str; N]) -> Option<[Option<Item<'b>>; N]> {
    let mut items = [None; N];
    let map = Item::take(&mut rest).filter(|map| map.kind == MAP)?;
    let mut entries_left = map.value;
    while entries_left > 0 {
        let key = Item::take(&mut rest)?;
        if key.kind == SIMPLE && key.value == OPEN && map.value == OPEN {
            break;
        }
        let item = Item::take(&mut rest).filter(|_| key.kind == TEXT)?;
        item.skip(&mut rest)?;
        if let Some(place) = keys.iter().position(|known| known.as_bytes() == key.content) {
            items[place] = Some(item);
        }
        entries_left -= 1;
    }
    rest.is_empty().then_some(items)
}

/// Writes items into a buffer.
pub(crate) struct Writer<'b> {
    buffer: &'b mut [u8],
    /// Length of the items. If it exceeds the buffer, the buffer was too short.
    pub(crate) len: usize,
}

impl<'b> Writer<'b> {
    pub(crate) fn new(buffer: &'b mut [u8]) -> Self {
        Self { buffer, len: 0 }
    }

    fn push(&mut self, bytes: &[u8]) {
        if let Some(place) = self.buffer.get_mut(self.len..self.len + bytes.len()) {
            place.copy_from_slice(bytes);
        }
        self.len += bytes.len();
    }

    /// Writes the head of an item: its major type, and its number or length.
    fn begin(&mut self, kind: u8, value: u32) {
        let [.., third, fourth] = value.to_be_bytes();
        match value {
            0..=23 => self.push(&[kind << 5 | fourth]),
            24..=0xff => self.push(&[kind << 5 | 24, fourth]),
            0x100..=0xffff => self.push(&[kind << 5 | 25, third, fourth]),
            _ => {
                self.push(&[kind << 5 | 26]);
                self.push(&value.to_be_bytes());
            }
        }
    }

    pub(crate) fn number(&mut self, number: u32) {
        self.begin(NUMBER, number);
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.begin(BYTES, bytes.len() as u32);
        self.push(bytes);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.begin(TEXT, text.len() as u32);
        self.push(text.as_bytes());
    }

    pub(crate) fn flag(&mut self, flag: bool) {
        self.begin(SIMPLE, FALSE + u32::from(flag));
    }

    /// Begins an array of this many items.
    pub(crate) fn array(&mut self, items: u32) {
        self.begin(ARRAY, items);
    }

    /// Begins a map of this many entries, of which each is a text and an item.
    pub(crate) fn map(&mut self, entries: u32) {
        self.begin(MAP, entries);
    }
}
