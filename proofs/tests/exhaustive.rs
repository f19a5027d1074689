//! Each property for all inputs within its bounds. `cargo xtask assure` sets the environment variable `PLANTAR_ASSURE`, for
//! larger bounds.

use critical_section as _; // links the host's implementation of the critical sections that the firmware uses
use plantar::firmware::supervise::{MOST_CHECKS, Part, START_CHECKS};
use plantar::protocol::update::{CHUNK, Header};
use plantar::protocol::{Capacity, MAX_MESSAGE, Resolution, ToDevice, ToHost};
use plantar::storage::flash_map::{LARGEST_CHIP, SECTOR, SMALLEST_CHIP};
use proofs::acknowledgement::EVENTS;
use proofs::calendar::Day;
use proofs::fragments::Fragment;
use proofs::{
    acknowledgement, all_bytes, cells, codec, flash, fragments, image, numbers, order, sequences, streams, supervision,
};

/// The bound of this run: `long` with `PLANTAR_ASSURE`, `short` otherwise.
fn bound<T>(short: T, long: T) -> T {
    if std::env::var_os("PLANTAR_ASSURE").is_some() { long } else { short }
}

/// All numbers that are at most `distance` away from one of `numbers`, modulo 2^32.
fn around<const N: usize>(numbers: [u32; N], distance: u32) -> impl Iterator<Item = u32> {
    let offsets = 0..=2 * distance;
    numbers.into_iter().flat_map(move |number| {
        let first = number.wrapping_sub(distance);
        offsets.clone().map(move |offset| first.wrapping_add(offset))
    })
}

/// The order depends only on the distance of two numbers. A long run checks all 2^32 distances.
#[test]
fn a_sequence_number_is_after_the_nearest_2_to_the_31_minus_1_numbers_before_it() {
    let origins = [0, 1, 1 << 31, u32::MAX];
    for from in origins {
        if bound(false, true) {
            (0..=u32::MAX).for_each(|distance| numbers::order(from, distance));
        }
        around([0, 1 << 31], 1 << 16).for_each(|distance| numbers::order(from, distance));
    }
    for from in around(origins, 1 << 12) {
        around([0, 1 << 31], 1 << 8).for_each(|distance| numbers::order(from, distance));
    }
}

#[test]
fn every_lost_live_frame_is_counted_once() {
    let due = bound(12, 16);
    for arrived in 0..1 << due {
        (0..=due).for_each(|status| numbers::live_losses(arrived, due, status));
    }
}

#[test]
fn a_stream_of_cells_has_the_highest_rate_that_fits() {
    for resolution in [Resolution::Converter, Resolution::Oversampled] {
        for cells in (0..=256).step_by(bound(16, 1)) {
            for period_us in [0, 1, 999, 2_500, 10_000, 10_001, 1_000_000, u32::MAX] {
                let bytes =
                    [0, 1, 960, 9_200, 9_201, 11_520, 46_080, 92_160, 1_000_000, u32::MAX].map(Capacity::of_bytes);
                let values = [0, 1, 100, 101, 133, 400, 5_000];
                let values = values.map(|packets_per_s| Capacity { packets_per_s, packet_bytes: 243 });
                for carrier in bytes.into_iter().chain(values) {
                    (0..=255).for_each(|every| numbers::fitting_rate(resolution, every, cells, period_us, carrier));
                }
            }
        }
    }
}

#[test]
fn the_checksum_of_short_messages_is_the_crc_32_by_its_definition() {
    sequences(&all_bytes(), bound(2, 3), codec::checksum);
}

#[test]
fn the_decoder_finds_exactly_the_intact_frames_of_a_short_stream() {
    sequences(&all_bytes(), bound(2, 3), codec::stream);
    // An empty message with its checksum is a frame of five ones and a zero.
    sequences(&[0, 1, 2, 3, 6, 255], bound(7, 9), codec::stream);
}

#[test]
fn the_decoder_refuses_exactly_the_messages_that_are_too_long() {
    (0..2 * MAX_MESSAGE).for_each(codec::length);
}

#[test]
fn a_message_is_framed_by_the_definition_and_decoded_again() {
    sequences(&all_bytes(), bound(1, 2), codec::framing);
    sequences(&[0, 1, 254, 255], bound(8, 10), codec::framing);
    // Messages of all lengths, with a zero in one place, in every place, or nowhere.
    for len in 0..=MAX_MESSAGE {
        codec::framing(&vec![0; len]);
        codec::framing(&vec![7; len]);
        for zero in (0..len).step_by(bound(7, 1)) {
            let mut message = vec![7; len];
            message[zero] = 0;
            codec::framing(&message);
        }
    }
}

#[test]
fn two_damaged_bytes_never_produce_another_message() {
    let bytes = bound(vec![0, 1, 2, 5, 6, 7, 254, 255], all_bytes().to_vec());
    // The frame of each of these messages, with its final zero, has six bytes more than the message.
    for message in [vec![], vec![0], vec![1], vec![255]] {
        let len = message.len() + 6;
        for (first, second) in (0..len).flat_map(|first| (first..len).map(move |second| (first, second))) {
            for &a in &bytes {
                bytes.iter().for_each(|&b| codec::damage(&message, [first, second], [a, b]));
            }
        }
    }
}

#[test]
fn short_byte_sequences_are_refused_or_decoded_as_host_messages_that_can_be_encoded() {
    let mut decoded = 0;
    sequences(&all_bytes(), bound(2, 3), |bytes| decoded += u32::from(codec::message_of::<ToDevice>(bytes)));
    assert!(decoded > 0);
}

#[test]
fn short_byte_sequences_are_refused_or_decoded_as_insole_messages_that_can_be_encoded() {
    let mut decoded = 0;
    sequences(&all_bytes(), bound(2, 3), |bytes| decoded += u32::from(codec::message_of::<ToHost>(bytes)));
    assert!(decoded > 0);
}

#[test]
fn the_joiner_accepts_exactly_the_fragments_that_continue_their_message() {
    let numbers = [Some(0), Some(1), Some(2), Some(127)];
    let parts = numbers.into_iter().flat_map(|number| {
        [false, true].into_iter().flat_map(move |is_last| [0, 300].map(|len| Fragment { number, is_last, len }))
    });
    let without_header = Fragment { number: None, is_last: false, len: 0 };
    let alphabet: Vec<_> = parts.chain([without_header]).collect();
    sequences(&alphabet, bound(4, 5), fragments::joining);
    // Messages of all lengths, and two that are too long, in two fragments of any lengths; then a fragment after the last one.
    for len in 0..=MAX_MESSAGE + 2 {
        for first in 0..=len {
            let part = |number, is_last, len| Fragment { number: Some(number), is_last, len };
            fragments::joining(&[part(0, false, first), part(1, true, len - first), part(2, true, 0)]);
        }
    }
}

/// Over Bluetooth, requests of management tools arrive in parts without headers; the first bytes of a message state its length.
/// Here, the stated and the actual length are near each other and near the limits.
#[test]
fn the_joiner_accepts_parts_without_headers_up_to_the_stated_length() {
    let most = MAX_MESSAGE as u16;
    for stated in [0, 1, 2, 3, 100, most - 1, most, most + 1, u16::MAX] {
        for first in 0..=MAX_MESSAGE + 1 {
            let left = [usize::from(stated), MAX_MESSAGE].map(|end| end.saturating_sub(first));
            for second in [0, 1, 2, left[0], left[0].min(MAX_MESSAGE) + 1, left[1], left[1] + 1] {
                fragments::joining_plain(stated, &[first, second, 1, 2]);
            }
        }
    }
}

/// The number after 127 is 0, which begins a message.
#[test]
fn the_joiner_never_joins_more_fragments_than_it_can_number() {
    for last in 0..300 {
        let fragment = |at: usize| Fragment { number: Some(at as u8 % 128), is_last: at == last, len: 1 };
        fragments::joining(&(0..=last).map(fragment).collect::<Vec<_>>());
    }
}

#[test]
fn a_message_is_split_into_full_fragments_and_joined_again() {
    for len in 0..=MAX_MESSAGE {
        (6..=MAX_MESSAGE + 2).step_by(bound(5, 1)).for_each(|room| fragments::splitting(len, room));
    }
}

/// All orders, losses and repetitions of the fragments of a message.
#[test]
fn fragments_in_any_order_with_losses_and_repetitions_yield_the_message_or_nothing() {
    for count in 1..=4 {
        let split = fragments::split(5 * count - 1, 6);
        assert_eq!(split.len(), count);
        let indices: Vec<_> = (0..count).collect();
        sequences(&indices, bound(7, 10), |order| fragments::disorder(&split, order));
    }
}

/// The offsets around the beginning, the page boundaries and the end of an area, a page after its end, and the largest offset.
fn offsets(len: u32) -> impl Iterator<Item = u32> {
    around([0, 256, 512, len, 256 + len, u32::MAX], bound(3, 40))
}

#[test]
fn a_partition_returns_the_bytes_of_its_area_only() {
    let mut bytes = [0; 3 * CHUNK];
    for start in [0, 256, 4096, LARGEST_CHIP - 1024] {
        for len in [0, 1, 255, 256, 257, 1024] {
            for (before, offset) in offsets(len).flat_map(|offset| [0, 300, 1023].map(|before| (before, offset))) {
                for count in (0..=600).step_by(bound(23, 1)).chain([255, 256, 257, 511, 512, 513]) {
                    flash::read(start..start + len, before, offset, &mut bytes[..count]);
                }
            }
        }
    }
}

#[test]
fn a_partition_changes_bytes_of_its_area_only() {
    let bytes = [0; 600];
    for start in [0, 256, 4096, LARGEST_CHIP - 1024] {
        for len in [0, 1, 255, 256, 257, 1024] {
            for offset in offsets(len) {
                (0..=bytes.len()).for_each(|count| flash::change(start..start + len, offset, &bytes[..count]));
            }
        }
    }
}

#[test]
fn no_sector_of_a_chip_belongs_to_two_areas() {
    for chip_bytes in (1..=8).map(|factor| factor * SMALLEST_CHIP).chain([LARGEST_CHIP - 1, LARGEST_CHIP - SECTOR]) {
        (0..2 * LARGEST_CHIP).step_by(SECTOR as usize).for_each(|sector| flash::map(chip_bytes, sector));
    }
}

#[test]
fn a_version_is_read_as_it_is_written() {
    let mut text = String::new();
    sequences(&['0', '6', '.', '+', 'a'], bound(7, 9), |version| {
        text.clear();
        text.extend(version);
        image::version(&text);
    });
    for number in 0..=70_000 {
        image::version(&format!("{number}.0.1"));
        image::version(&format!("0.{number}.1+x"));
        image::version(&format!("0.1.{number}"));
    }
}

#[test]
fn a_damaged_header_is_accepted_only_with_its_magic_number_and_a_valid_version() {
    let header = Header::new("board", "1.22.333").bytes();
    for (first, second) in (0..header.len()).flat_map(|first| (first..header.len()).map(move |second| (first, second)))
    {
        for a in (0..=255).step_by(bound(5, 1)) {
            for b in [0, b'.', b'7', b'+', 0xff] {
                let mut changed = header;
                (changed[first], changed[second]) = (a, b);
                image::header(&changed);
            }
        }
    }
}

#[test]
fn a_session_sends_no_acknowledged_record_again_and_loses_none_without_counting_it() {
    for first in [0, u32::MAX - 4] {
        sequences(&EVENTS, bound(5, 7), |events| acknowledgement::session(first, events));
    }
}

/// One part has heartbeats before some of the checks, in all combinations, and the others before every check; or two parts stop
/// at any two checks.
#[test]
fn the_watchdog_reports_the_parts_that_were_silent_for_too_long_or_almost() {
    let checks = bound(14, 18);
    for part in [Part::Scan, Part::Process, Part::Link] {
        for pattern in 0u32..1 << checks {
            supervision::watchdog(checks, |other, check| other != part || pattern >> check & 1 == 1);
        }
    }
    let longest = bound(16, 40);
    for (one, other) in supervision::ALL.into_iter().flat_map(|one| supervision::ALL.map(|other| (one, other))) {
        let most = u32::from(MOST_CHECKS[one as usize].max(MOST_CHECKS[other as usize]));
        for (first, second) in (0..longest).flat_map(|first| (0..longest).map(move |second| (first, second))) {
            supervision::watchdog(most + longest, |part, check| {
                (part != one || check < first) && (part != other || check < second)
            });
        }
    }
}

/// Each part stops for a time around its limit, and continues.
#[test]
fn a_part_that_continues_in_time_is_not_reported() {
    for part in supervision::ALL {
        let most = u32::from(MOST_CHECKS[part as usize]);
        for (stop, silent) in (1..4).flat_map(|stop| (most - 3..most + 3).map(move |silent| (stop, silent))) {
            supervision::watchdog(most + 20, |other, check| other != part || !(stop..stop + silent).contains(&check));
        }
        // The part never has a heartbeat, and the others have none in the first half of the time that a start may take; or no
        // part ever has one.
        supervision::watchdog(START_CHECKS + most + 3, |other, check| other != part && check > START_CHECKS / 2);
        supervision::watchdog(START_CHECKS + most + 3, |_, _| false);
    }
}

/// All pairs of successive codes of the converter (in a short run, those with every 17th first code), one pair for each group
/// of eight cells; then pairs of oversampled codes, and all numbers of cells.
#[test]
fn codes_are_unpacked_as_they_were_packed() {
    const GROUPS: u16 = 32;
    for before in (0..4096).step_by(bound(17, 1)) {
        for after in (0..4096).step_by(usize::from(GROUPS)) {
            let codes: Vec<u16> = (0..GROUPS).flat_map(|group| [(after + group) << 4; 8]).collect();
            cells::packing(Resolution::Converter, &[before << 4; 256], &codes);
        }
    }
    for before in (0..=u16::MAX).step_by(bound(8191, 257)) {
        for after in (0..=u16::MAX).step_by(usize::from(GROUPS)) {
            let codes: Vec<u16> = (0..GROUPS).flat_map(|group| [after + group; 8]).collect();
            cells::packing(Resolution::Oversampled, &[before; 256], &codes);
        }
    }
    for count in 0..=256 {
        for bit in 0..16 {
            let codes: Vec<u16> = (0..count).map(|cell| 1 << ((bit + cell) % 16)).collect();
            for resolution in [Resolution::Converter, Resolution::Oversampled] {
                cells::packing(resolution, &vec![1 << bit; count as usize], &codes);
            }
        }
    }
}

/// Every day until the end of the year 2099, or in a long run 2499, at a time that differs from day to day; then every second of
/// a day.
#[test]
fn every_day_is_encoded_as_the_calendar_counts_it() {
    let mut day = Day::FIRST;
    for number in 0.. {
        if day.year() == bound(2100, 2500) {
            break;
        }
        day.encoding(number, (number * 977 % 86_400) as u32, (number % 256) as u8);
        day = day.next();
    }
    (0..86_400).for_each(|second| Day::FIRST.encoding(0, second, (second % 256) as u8));
}

#[test]
fn a_field_of_a_time_with_an_impossible_value_is_refused() {
    let mut day = Day::FIRST;
    while day.year() < bound(1977, 2110) {
        for field in 2..10 {
            (0..=255).for_each(|value| day.field(field, value));
        }
        day = day.next();
    }
}

#[test]
fn a_stream_of_cells_sends_the_due_frames_in_order_and_counts_the_dropped_ones() {
    for every in 0..=3 {
        sequences(&[true, false], bound(12, 16), |events| streams::cells(every, events));
    }
    for every in 0..=255 {
        streams::cells(every, &[[true; 4].as_slice(), &[false; 2]].concat().repeat(100));
    }
}

#[test]
fn a_stream_of_ellipses_sends_the_newest_due_ellipses() {
    for period_us in [0, 1, 156, 157, 2_500, 10_000, 39_999, 40_000, 40_001, 1_000_000] {
        for every in 0..=255 {
            for taken in [0, 0x0000_0100, 0x5555_5555, 0x9249_2492, u32::MAX] {
                streams::ellipses(every, period_us, bound(300, 3000), taken);
            }
        }
    }
}

#[test]
fn a_session_sends_records_first_and_at_most_eight_live_frames_before_an_answer() {
    use order::Event;
    let alphabet = [Event::Live, Event::Ask, Event::Record, Event::Send];
    // The queue holds six records; one more would drop a record.
    let count = |events: &[Event]| events.iter().filter(|event| **event == Event::Record).count();
    sequences(&alphabet, bound(6, 8), |events| {
        if count(events) <= 6 {
            order::message_order(&[events, &[Event::Send; 20]].concat());
        }
    });
}

#[test]
fn a_serial_number_is_a_short_printable_text() {
    for (first, second) in (0..=255).flat_map(|first| (0..=255).map(move |second| (first, second))) {
        let text: String = [char::from(first), char::from(second)].into_iter().collect();
        image::serial(&text);
        image::serial(&text[..0]);
    }
    (0..20).for_each(|len| image::serial(&"~".repeat(len)));
    sequences(&[0, b'a', b' ', 0xff], bound(6, 9), |start| {
        for padding in [0, b'!'] {
            let mut bytes = [padding; 16];
            bytes[..start.len()].copy_from_slice(start);
            image::serial_bytes(bytes);
        }
    });
}
