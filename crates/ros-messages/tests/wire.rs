//! Round trips, and invalid bytes.

use std::borrow::Cow;

use proptest::prelude::*;
use stillpoint_ros_messages::*;

const FORMATS: [Format; 3] = [Format::CdrLittleEndian, Format::CdrBigEndian, Format::Ros1];

fn image(frame_id: &str, data: &[u8]) -> Image<'static> {
    let stamp = Time {
        sec: 1_305_031_102,
        nanosec: 175_304_000,
    };
    Image {
        header: Header {
            seq: 0,
            stamp,
            frame_id: frame_id.to_owned().into(),
        },
        height: 1,
        width: 2,
        encoding: "rgb8".into(),
        is_bigendian: 0,
        step: 6,
        data: data.to_vec().into(),
    }
}

fn info(values: &[f64]) -> CameraInfo<'static> {
    let mut info = CameraInfo {
        width: 640,
        d: values.to_vec(),
        ..CameraInfo::default()
    };
    info.distortion_model = "plumb_bob".into();
    info.k[0] = 517.3;
    info.roi.do_rectify = true;
    info
}

fn tree(names: &[String]) -> TfMessage<'_> {
    let each = |name: &'_ String| {
        let name: Cow<'_, str> = Cow::Owned(name.clone());
        TransformStamped {
            child_frame_id: name,
            ..TransformStamped::default()
        }
    };
    TfMessage {
        transforms: names.iter().map(each).collect(),
    }
}

proptest! {
    /// Names of every length, so that later fields begin at every offset.
    #[test]
    fn messages_round_trip(
        name in "\\PC{0,12}",
        data in prop::collection::vec(any::<u8>(), 0..40),
        values in prop::collection::vec(-1e9..1e9_f64, 0..9),
        names in prop::collection::vec("[a-z_]{0,9}", 0..5),
    ) {
        for format in FORMATS {
            let sent = image(&name, &data);
            let bytes = to_bytes(&sent, format);
            prop_assert_eq!(from_bytes::<Image<'_>>(&bytes, format).unwrap(), sent);
            let sent = info(&values);
            let bytes = to_bytes(&sent, format);
            prop_assert_eq!(from_bytes::<CameraInfo<'_>>(&bytes, format).unwrap(), sent);
            let sent = tree(&names);
            let bytes = to_bytes(&sent, format);
            prop_assert_eq!(from_bytes::<TfMessage<'_>>(&bytes, format).unwrap(), sent);
        }
    }

    /// A changed or truncated message gives another message or an error, and never more elements than bytes.
    #[test]
    fn changed_bytes_do_not_panic(at in any::<prop::sample::Index>(), to in any::<u8>(), cut in any::<prop::sample::Index>()) {
        for format in FORMATS {
            let names = ["base".to_owned(), "camera".to_owned()];
            for mut bytes in [to_bytes(&image("c", &[1; 9]), format), to_bytes(&info(&[1.0]), format), to_bytes(&tree(&names), format)] {
                let changed = at.index(bytes.len());
                bytes[changed] = to;
                bytes.truncate(cut.index(bytes.len()) + 1);
                let _ = from_bytes::<Image<'_>>(&bytes, format);
                if let Ok(info) = from_bytes::<CameraInfo<'_>>(&bytes, format) {
                    prop_assert!(info.d.len() <= bytes.len());
                }
                if let Ok(tree) = from_bytes::<TfMessage<'_>>(&bytes, format) {
                    prop_assert!(tree.transforms.len() <= bytes.len());
                }
            }
        }
    }
}

#[test]
fn every_truncation_is_refused() {
    for format in FORMATS {
        let bytes = to_bytes(&image("camera", &[1, 2, 3]), format);
        for end in 0..bytes.len() {
            let cut = from_bytes::<Image<'_>>(&bytes[..end], format);
            let short = |e: &WireError| matches!(e.reason(), WireError::Short { .. });
            assert!(cut.as_ref().is_err_and(short), "{format:?} {end}: {cut:?}");
        }
    }
}

#[test]
fn images_are_borrowed() {
    let bytes = to_bytes(&image("camera", &[1, 2, 3]), Format::CdrLittleEndian);
    let read: Image<'_> = from_bytes(&bytes, Format::CdrLittleEndian).unwrap();
    assert!(matches!(read.data, Cow::Borrowed(_)));
}

#[test]
fn stated_length_allocates_nothing() {
    let bytes = [0, 1, 0, 0, 255, 255, 255, 255];
    let expected = WireError::Short {
        at: 8,
        needed: u32::MAX as usize,
        left: 0,
    };
    let found = from_bytes::<TfMessage<'_>>(&bytes, Format::CdrLittleEndian);
    assert_eq!(found.unwrap_err().reason(), &expected);
}

#[test]
fn errors_name_message_and_field() {
    let names = ["base".to_owned(), "camera".to_owned()];
    let bytes = to_bytes(&tree(&names), Format::Ros1);
    let cut = from_bytes::<TfMessage<'_>>(&bytes[..bytes.len() - 1], Format::Ros1);
    assert_eq!(
        cut.unwrap_err().to_string(),
        "tf2_msgs/msg/TFMessage, field transforms[1].transform.rotation.w: expected 8 bytes at byte 158, found 7"
    );
    let marker = to_bytes(&Marker::default(), Format::CdrLittleEndian);
    let cut = from_bytes::<Marker<'_>>(&marker[..20], Format::CdrLittleEndian).unwrap_err();
    assert!(
        cut.to_string()
            .starts_with("visualization_msgs/msg/Marker, field ns: "),
        "{cut}"
    );
}

#[test]
fn unknown_encapsulations_are_reported() {
    let found = from_bytes::<StringMessage<'_>>(&[0, 7, 0, 0], Format::CdrLittleEndian);
    assert_eq!(found, Err(WireError::Encapsulation { found: [0, 7] }));
}
