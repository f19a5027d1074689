//! Messages, as the web page for a phone (`tools/phone`) decodes them: the result is valid JSON with the kind of the message.

use phone_wire::decode_to_json;

/// Checks one input.
pub fn check(data: &[u8]) {
    if let Some(value) = decode_to_json(data) {
        let read: serde_json::Value = serde_json::from_str(&value.to_string()).expect("the text is valid JSON");
        assert!(read["kind"].is_string());
    }
}
