//! The messages of management tools (MCUmgr). The bytes of requests and lines were made by the Python package `smp` 4.2. Answers
//! are read by an independent implementation of CBOR, `ciborium`.

use ciborium::{Value, cbor};
use mcumgr::line::{END, Lines, MAX_LINES, MAX_WRAPPED, unwrap, wrap};
use mcumgr::{Answer, CHUNK, Clock, Failure, HEAD, Head, ImageState, Request, Upload, decode, message_bytes};
use plantar::protocol::update::{self, Chunk};
use plantar::protocol::{Decoder, MAX_FRAME, ToDevice, encode, frame};
use proptest::prelude::*;

fn bytes(hex: &str) -> Vec<u8> {
    let digits = hex.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).expect("the text is ASCII"));
    digits.map(|pair| u8::from_str_radix(pair, 16).expect("the text is hex")).collect()
}

/// The request in a message.
fn decoded(hex: &str) -> Result<Request, Failure> {
    decode(&bytes(hex)).expect("the message is a request").1
}

#[test]
fn the_requests_of_tools_are_decoded() {
    let clock = Clock { year: 2026, numbers: [3, 31, 12, 34, 56], zone_min: 0 };
    let sha256 = std::array::from_fn(|i| i as u8);
    let first_part = Upload {
        offset: 0,
        file_bytes: Some(70_000),
        sha256: Some(std::array::from_fn(|i| i as u8 + 32)),
        must_be_newer: true,
        data: (0..40).collect(),
    };
    let further_part = Upload {
        offset: 66_000,
        file_bytes: None,
        sha256: None,
        must_be_newer: false,
        data: std::iter::repeat_n(7, 130).collect(),
    };
    let further_hex = format!("0a00009300010a01a2636f66661a000101d064646174615882{}", "07".repeat(130));
    for (hex, expected) in [
        ("0a00000a00000100a1616466496e736f6c65", Request::Echo("Insole".try_into().expect("short"))),
        ("0800000100000206a0", Request::Parameters),
        ("0800000100000304a0", Request::GetTime),
        ("0a00001e00000404a1686461746574696d6573323032362d30332d33315431323a33343a3536", Request::SetTime(clock)),
        ("0a00000100000505a0", Request::Reset),
        ("0800000100010600a0", Request::GetImages),
        (
            "0a00002800010700a164686173685820000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f",
            Request::SetImage { sha256: Some(sha256), is_confirmed: false },
        ),
        ("0a00000a00010800a167636f6e6669726df5", Request::SetImage { sha256: None, is_confirmed: true }),
        (
            "0a00007400010901a6636c656e1a00011170636f666600637368615820202122232425262728292a2b2c2d2e2f303132333435363738\
             393a3b3c3d3e3f64646174615828000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f2021222324252627\
             65696d616765006775706772616465f5",
            Request::Upload(first_part),
        ),
        (&further_hex, Request::Upload(further_part)),
        ("0a00000700010b05a164736c6f7401", Request::Erase),
        // An empty body, and a map of indefinite length, as some tools encode them.
        ("080000000000ff06", Request::Parameters),
        ("0a00000b00010800bf67636f6e6669726df5ff", Request::SetImage { sha256: None, is_confirmed: true }),
        // Fields that this protocol does not have are ignored, with everything in them.
        (
            "0a00001300010800a2617a82a1617901c10267636f6e6669726df4",
            Request::SetImage { sha256: None, is_confirmed: false },
        ),
    ] {
        assert_eq!(decoded(hex), Ok(expected), "{hex}");
    }
    let (head, _) = decode(&bytes("0000000100010c00a0")).expect("the message is a request");
    assert_eq!(head, Head { is_write: false, version: 0, group: 1, sequence: 12, command: 0 });
}

#[test]
fn requests_that_are_malformed_or_not_supported_are_refused() {
    for (hex, failure) in [
        ("0800000100000d02a0", Failure::NOT_SUPPORTED),
        ("0800000100400d00a0", Failure::NOT_SUPPORTED),
        // Reset as a reading request.
        ("0800000100000505a0", Failure::NOT_SUPPORTED),
        // An echo without a text, and with a number instead.
        ("0a00000100000100a0", Failure::INVALID),
        ("0a00000400000100a1616405", Failure::INVALID),
        // A text that is longer than the message, one that is not UTF-8, and bytes after the map.
        ("0a00000500000100a161646249", Failure::INVALID),
        ("0a00000500000100a1616461ff", Failure::INVALID),
        ("0a00000500000100a161646049", Failure::INVALID),
        // A hash of three bytes, another slot, another image, and a part without an offset.
        ("0a00000a00010700a1646861736843010203", Failure::HASH),
        ("0a00000700010b05a164736c6f7400", Failure::SLOT),
        ("0a00001300010901a3636f666600646461746140 65696d61676501", Failure::SLOT),
        ("0a00000700010901a1646461746140", Failure::OFFSET),
        // A month with three characters.
        ("0a00001e00000404a1686461746574696d6573323032362d3033302d33315431323a33343a35", Failure::INVALID),
    ] {
        assert_eq!(decoded(&hex.replace(' ', "")), Err(failure), "{hex}");
    }
    // Answers, and messages of another length than their head states, are no requests.
    for hex in ["0b00000100000505a0", "0a00000200000505a0", "0a000001000005", ""] {
        assert_eq!(decode(&bytes(hex)), None, "{hex}");
    }
    let long = cbor!({ "d" => "x".repeat(CHUNK + 1) }).expect("a value");
    assert_eq!(decode(&message(2, 0, 0, &long)).map(|(_, request)| request), Some(Err(Failure::TOO_LONG)));
}

/// A request with these fields, encoded independently.
fn message(op: u8, group: u8, command: u8, fields: &Value) -> Vec<u8> {
    let mut body = Vec::new();
    ciborium::into_writer(fields, &mut body).expect("a vector takes all bytes");
    let [high, low] = (body.len() as u16).to_be_bytes();
    [&[1 << 3 | op, 0, high, low, 0, group, 9, command], &body[..]].concat()
}

/// The head and the fields of an answer.
fn answered(answer: &Answer, version: u8) -> (Vec<u8>, Value) {
    let head = Head { is_write: true, version, group: 1, sequence: 77, command: 5 };
    let mut buffer = [0; MAX_WRAPPED];
    let encoded = answer.encode(&head, &mut buffer).expect("the answer fits");
    assert_eq!(message_bytes(encoded), Some(encoded.len()));
    let (head, body) = encoded.split_at(HEAD);
    (head.to_vec(), ciborium::from_reader(body).expect("the answer is valid CBOR"))
}

#[test]
fn answers_have_the_form_that_tools_expect() {
    let state = ImageState {
        version: "1.22.333+abcdef0".try_into().expect("the longest version"),
        sha256: [0xee; 32],
        is_pending: true,
        is_confirmed: false,
    };
    let image = |slot: u8, active: bool| {
        cbor!({
            "slot" => slot, "version" => "1.22.333+abcdef0", "hash" => Value::Bytes(vec![0xee; 32]), "bootable" => true,
            "pending" => true, "confirmed" => false, "active" => active, "permanent" => false,
        })
    };
    let images = cbor!({ "images" => [image(0, true).unwrap(), image(1, false).unwrap()] });
    let text = "ä".repeat(CHUNK / 2);
    let clock = Clock { year: 2026, numbers: [1, 2, 3, 4, 5], zone_min: 0 };
    for (answer, fields) in [
        (Answer::Done, cbor!({})),
        (Answer::Echo(text.as_str().try_into().expect("the longest text")), cbor!({ "r" => text })),
        (Answer::Parameters, cbor!({ "buf_size" => 204, "buf_count" => 1 })),
        (Answer::Time(clock), cbor!({ "datetime" => "2026-01-02T03:04:05" })),
        (Answer::Offset(70_000), cbor!({ "off" => 70_000 })),
        (Answer::Images([Some(state.clone()), Some(state)]), images),
        (Answer::Failed(Failure::RUNS), cbor!({ "err" => { "group" => 1, "rc" => 33 } })),
        (Answer::Failed(Failure::NO_TIME), cbor!({ "err" => { "group" => 0, "rc" => 4 } })),
        (Answer::Failed(Failure::NOT_SUPPORTED), cbor!({ "rc" => 8 })),
    ] {
        let (head, body) = answered(&answer, 1);
        assert_eq!((head[0], &head[4..]), (0x0b, &[0, 1, 77, 5][..]));
        assert_eq!(Some(body), fields.ok());
    }
    // Tools of the first version know only the common codes.
    let (head, body) = answered(&Answer::Failed(Failure::RUNS), 0);
    assert_eq!((head[0], Some(body)), (0x03, cbor!({ "rc" => 6 }).ok()));
    assert_eq!(
        Answer::Done.encode(&Head { is_write: true, version: 1, group: 0, sequence: 0, command: 0 }, &mut [0; HEAD]),
        None
    );
}

#[test]
fn lines_are_those_of_the_python_package() {
    let part = bytes(&format!("0a00009300010a01a2636f66661a000101d064646174615882{}", "07".repeat(130)));
    let part_lines = concat!(
        "\x06\tAJ0KAACTAAEKAaJjb2ZmGgABAdBkZGF0YViCBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcH\n",
        "\x04\x14BwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHBwcHB/LT\n",
    );
    for (message, lines) in [
        (bytes("0a00000a00000100a1616466496e736f6c65"), "\x06\tABQKAAAKAAABAKFhZGZJbnNvbGWxZA==\n"),
        (bytes("0a00000700010b05a164736c6f7401"), "\x06\tABEKAAAHAAELBaFkc2xvdAHjEg==\n"),
        (part, part_lines),
    ] {
        let mut wrapped = [0; MAX_LINES];
        let len = wrap(&message, &mut wrapped);
        assert_eq!(String::from_utf8_lossy(&wrapped[..len]), lines);
        assert_eq!(unwrap(&mut wrapped[..len]), Lines::Message(&message));
    }
    // Tools may choose shorter lines, and end them like a terminal.
    for lines in [
        "\x06\tAH4KAAB0AAEJAaZjbGVuGgABEXBjb2ZmAGNzaGFYICAhIiMkJSYnKCkqKywt\n\x04\x14Li8wMTIzNDU2Nzg5Ojs8PT4/ZGRhdGFYKAABAgME\
         BQYHCAkKCwwNDg8QERIT\n\x04\x14FBUWFxgZGhscHR4fICEiIyQlJidlaW1hZ2UAZ3VwZ3JhZGX1jVQ=\n",
        "\x06\tAAsI\r\n\x04\x14AAABAAEGAKAdoQ==\r\n",
    ] {
        let mut received = lines.as_bytes().to_vec();
        let first_end = lines.find('\n').expect("there is a line") + 1;
        assert_eq!(unwrap(&mut received[..first_end]), Lines::Incomplete);
        let Lines::Message(message) = unwrap(&mut received) else { panic!("no message in {lines:?}") };
        assert!(decode(message).is_some_and(|(_, request)| request.is_ok()));
    }
}

#[test]
fn lines_with_any_flipped_bit_are_no_message() {
    let mut lines = [0; MAX_LINES];
    let len = wrap(&bytes("0a00000a00000100a1616466496e736f6c65"), &mut lines);
    for bit in 0..8 * len {
        let mut flipped = lines;
        flipped[bit / 8] ^= 1 << (bit % 8);
        // Ends of lines, padding and the unused bits of the last character have no meaning.
        let is_unused = lines[bit / 8] == END || lines[bit / 8..len].contains(&b'=') && len - bit / 8 <= 4;
        if !is_unused {
            assert!(!matches!(unwrap(&mut flipped[..len]), Lines::Message(_)), "bit {bit}");
        }
    }
}

/// Passes bytes to a decoder as the serial port does. Returns the messages of frames, and those of management tools.
fn receive(decoder: &mut Decoder, bytes: &[u8]) -> (Vec<Vec<u8>>, Vec<Vec<u8>>) {
    let (mut framed, mut managed) = (Vec::new(), Vec::new());
    for &byte in bytes {
        if let Some(message) = decoder.push(byte) {
            framed.push(message.to_vec());
        } else if byte == END
            && let Some(message) = decoder.management_message()
        {
            managed.push(message.to_vec());
        }
    }
    (framed, managed)
}

/// A message of the insole's own protocol, and its frame.
fn own_frame(message: &ToDevice) -> (Vec<u8>, Vec<u8>) {
    let (mut buffer, mut framed) = ([0; 560], [0; MAX_FRAME]);
    let message = encode(message, &mut buffer).expect("the message fits").to_vec();
    let len = frame(&message, &mut framed);
    (message, framed[..len].to_vec())
}

#[test]
fn frames_and_lines_share_a_port() {
    let mut lines = [0; MAX_LINES];
    let echo = bytes("0a00000a00000100a1616466496e736f6c65");
    let len = wrap(&echo, &mut lines);
    let lines = &lines[..len];
    let (status, status_frame) = own_frame(&ToDevice::GetStatus);
    let mut decoder = Decoder::new();
    let received = receive(&mut decoder, &[&status_frame, lines, lines, lines, &status_frame].concat());
    assert_eq!(received, (vec![status.clone(); 2], vec![echo.clone(); 3]));
    assert_eq!(decoder.bad_frames, 0);
    // Half a message, an incomplete line, noise, more noise than the buffer holds, and a line with a wrong CRC: the next message
    // arrives.
    let half = &lines[..len - 9];
    let noise: Vec<u8> = (1..=255).cycle().take(2 * MAX_FRAME).collect();
    for before in [half, b"\x06\tAA\n", b"noise", &noise, b"\x06\x09AAsIAAABAAEGAKAdoA==\n"] {
        let mut decoder = Decoder::new();
        let (_, managed) = receive(&mut decoder, &[before, b"\n", lines, lines].concat());
        assert!(managed.contains(&echo), "{before:?}");
        assert_eq!(receive(&mut decoder, &status_frame).0, std::slice::from_ref(&status));
    }
}

#[test]
fn a_frame_that_contains_the_beginning_of_a_tools_message_arrives() {
    for beginning in
        [&b"\x06\tAAAA\n"[..], b"\x06\t\x80\x81\x82\x83\n", b"\x06\tAAsIAAAB\n", b"\x06\t\n", b"\x06\t////\n"]
    {
        for rest in *b"A\x80\n\x06" {
            let mut chunk: Chunk = [[rest; 32]; 8];
            chunk[0][..beginning.len()].copy_from_slice(beginning);
            let (message, framed) = own_frame(&ToDevice::Update(update::Request::Chunk { number: 7, chunk }));
            let received = receive(&mut Decoder::new(), &framed);
            assert_eq!(received, (vec![message], vec![]), "{beginning:?} {rest}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_message_survives_its_lines(message in prop::collection::vec(any::<u8>(), 0..=MAX_WRAPPED)) {
        let mut lines = [0; MAX_LINES];
        let len = wrap(&message, &mut lines);
        prop_assert!(lines[..len].split_inclusive(|byte| *byte == END).all(|line| line.len() <= 127));
        prop_assert_eq!(unwrap(&mut lines[..len]), Lines::Message(&message));
    }

    #[test]
    fn every_offset_and_text_is_decoded(offset in any::<u32>(), text in "\\PC{0,60}", len in 0..=400_usize) {
        let data = vec![0x5a; len];
        let fields = cbor!({ "data" => Value::Bytes(data.clone()), "off" => offset, "x" => [1.5, null, -7] }).expect("a value");
        let Some((_, Ok(Request::Upload(part)))) = decode(&message(2, 1, 1, &fields)) else { panic!("refused") };
        prop_assert_eq!((part.offset, &part.data[..]), (offset, &data[..len.min(CHUNK)]));
        let fields = cbor!({ "d" => text.clone() }).expect("a value");
        prop_assert_eq!(
            decode(&message(2, 0, 0, &fields)).map(|(_, request)| request),
            Some(Ok(Request::Echo(text.as_str().try_into().expect("the text fits"))))
        );
    }

    #[test]
    fn any_bytes_are_decoded_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
        for group in 0..2 {
            for command in 0..7 {
                let [high, low] = (bytes.len() as u16).to_be_bytes();
                let _ = decode(&[&[0x0a, 0, high, low, 0, group, 1, command], &bytes[..]].concat());
            }
        }
        let _ = unwrap(&mut bytes.clone());
    }
}
