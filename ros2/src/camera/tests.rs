use super::*;
use crate::parameters::Parameters;
use stillpoint::ros_messages::to_bytes;

fn topics() -> CameraTopics {
    CameraTopics {
        colour: "/camera/color/image_raw".into(),
        depth: "/camera/depth/image_rect_raw".into(),
        colour_info: "/camera/color/camera_info".into(),
        depth_info: "/camera/depth/camera_info".into(),
        colour_compressed: false,
        depth_compressed: false,
    }
}

fn image(encoding: &'static str, frame: &'static str, bytes: usize) -> ImageMessage<'static> {
    ImageMessage::Raw(ros::Image {
        header: ros::Header {
            frame_id: frame.into(),
            ..ros::Header::default()
        },
        height: 6,
        width: 8,
        encoding: encoding.into(),
        is_bigendian: 0,
        step: 8 * bytes as u32,
        data: vec![1; 48 * bytes].into(),
    })
}

fn info(fx: f64) -> Vec<u8> {
    let info = ros::CameraInfo {
        height: 6,
        width: 8,
        k: [fx, 0.0, 4.0, 0.0, fx, 3.0, 0.0, 0.0, 1.0],
        ..ros::CameraInfo::default()
    };
    to_bytes(&info, Format::CdrLittleEndian)
}

fn transform(parent: &'static str, child: &'static str, x: f64) -> Vec<u8> {
    let mut t = ros::TransformStamped::default();
    t.header.frame_id = parent.into();
    t.child_frame_id = child.into();
    t.transform.translation.x = x;
    t.transform.rotation.w = 1.0;
    to_bytes(
        &ros::TfMessage {
            transforms: vec![t],
        },
        Format::CdrLittleEndian,
    )
}

#[test]
fn missing_inputs_are_reported_until_received() {
    let options = Options::new(&Parameters::default()).unwrap();
    let mut camera = CameraState::new(topics());
    let (colour, depth) = (image("rgb8", "colour", 3), image("16UC1", "depth", 2));
    let waits_for = waiting(&colour, &depth, &options);
    waits_for(&mut camera, "/camera/color/camera_info");
    assert_eq!(camera.take_info(false, info(5.0)), Ok(false));
    waits_for(&mut camera, "/camera/depth/camera_info");
    assert_eq!(camera.take_info(true, info(5.0)), Ok(false));
    waits_for(&mut camera, "depth -> colour on /tf_static");
    camera
        .take_transforms(&transform("link", "colour", 0.1))
        .unwrap();
    camera
        .take_transforms(&transform("link", "depth", 0.0))
        .unwrap();
    let ready = camera.ready(&colour, &depth, &options).ok().unwrap();
    assert_eq!(ready.optical, "colour");
    assert!(
        ready
            .incoming
            .guesses()
            .iter()
            .any(|g| g.contains("100.0 mm beside"))
    );
    // Only a different calibration counts as a change.
    assert_eq!(camera.take_info(false, info(5.0)), Ok(false));
    assert_eq!(camera.take_info(false, info(6.0)), Ok(true));
    // base -> link -> colour.
    camera
        .take_transforms(&transform("base_link", "link", 0.5))
        .unwrap();
    let base = camera.base_from_optical("base_link", "colour").unwrap();
    assert!((base.translation.x - 0.6).abs() < 1e-12);
}

/// Default options, with one parameter enabled.
fn asked_for(parameter: &str) -> Options {
    let mut parameters = Parameters::default();
    let yes = crate::value::Value::Bool(true);
    parameters.set(parameter, &yes).unwrap();
    Options::new(&parameters).unwrap()
}

/// Returns a check that a camera waits with these images, for the given reason.
fn waiting<'a>(
    colour: &'a ImageMessage<'a>,
    depth: &'a ImageMessage<'a>,
    options: &'a Options,
) -> impl Fn(&mut CameraState, &str) + 'a {
    move |camera, what| {
        let Err(NotReady::Waiting(told)) = camera.ready(colour, depth, options) else {
            panic!("{what}");
        };
        assert!(told.contains(what), "{told}");
    }
}

#[test]
fn run_waits_for_the_imu_mount() {
    let options = asked_for("subscribe_imu");
    let (colour, depth) = (image("rgb8", "colour", 3), image("16UC1", "colour", 2));
    let mut camera = CameraState::new(topics());
    camera.take_info(false, info(5.0)).unwrap();
    let waits_for = waiting(&colour, &depth, &options);
    waits_for(&mut camera, "no message of it");
    camera.note_inertial("imu");
    waits_for(&mut camera, "no imu -> colour on /tf_static");
    camera
        .take_transforms(&transform("colour", "imu", 0.01))
        .unwrap();
    let ready = camera.ready(&colour, &depth, &options).ok().unwrap();
    let mount = ready.imu.unwrap().camera_from_imu;
    assert!((mount.translation.x - 0.01).abs() < 1e-12 && ready.without_imu.is_none());
    let plain = Options::new(&Parameters::default()).unwrap();
    assert!(
        camera
            .ready(&colour, &depth, &plain)
            .ok()
            .unwrap()
            .imu
            .is_none()
    );
}

#[test]
fn run_waits_for_the_camera_mount_on_the_base() {
    let options = asked_for("subscribe_odometry");
    let (colour, depth) = (image("rgb8", "colour", 3), image("16UC1", "colour", 2));
    let mut camera = CameraState::new(topics());
    camera.take_info(false, info(5.0)).unwrap();
    let waits_for = waiting(&colour, &depth, &options);
    waits_for(&mut camera, "no message of it");
    camera.note_odometry(&["odom".into(), "base".into()]);
    waits_for(&mut camera, "no colour -> base on /tf_static");
    // Transforms through the odometry's frame give no mount.
    for pair in [["odom", "base"], ["odom", "colour"]] {
        let bytes = transform(pair[0], pair[1], 0.5);
        camera.take_transforms(&bytes).unwrap();
    }
    waits_for(&mut camera, "no colour -> base on /tf_static");
    camera.waiting = Instant::now().checked_sub(2 * PATIENCE);
    let ready = camera.ready(&colour, &depth, &options).ok().unwrap();
    assert!(ready.wheels.is_none() && ready.without_wheels.is_some());
    let bytes = transform("base", "colour", 0.01);
    camera.take_transforms(&bytes).unwrap();
    let ready = camera.ready(&colour, &depth, &options).ok().unwrap();
    let mount = ready.wheels.unwrap().base_from_camera;
    assert!((mount.translation.x - 0.01).abs() < 1e-12 && ready.without_wheels.is_none());
    let plain = Options::new(&Parameters::default()).unwrap();
    let ready = camera.ready(&colour, &depth, &plain).ok().unwrap();
    assert!(ready.wheels.is_none() && ready.without_wheels.is_none());
}

#[test]
fn run_begins_without_the_imu_after_a_timeout() {
    let options = asked_for("subscribe_imu");
    let mut camera = CameraState::new(topics());
    camera.take_info(false, info(5.0)).unwrap();
    camera.waiting = Instant::now().checked_sub(2 * PATIENCE);
    let (colour, depth) = (image("rgb8", "colour", 3), image("16UC1", "colour", 2));
    let ready = camera.ready(&colour, &depth, &options).ok().unwrap();
    assert!(ready.imu.is_none());
    assert!(ready.without_imu.unwrap().contains("inertial sensor"));
}

#[test]
fn unsupported_inputs_are_refused() {
    let options = Options::new(&Parameters::default()).unwrap();
    for (colour, depth, part) in [
        (image("rgb8", "c", 3), image("rgb8", "c", 3), "depth images"),
        (image("h264", "c", 3), image("16UC1", "c", 2), "h264"),
    ] {
        let mut camera = CameraState::new(topics());
        camera.take_info(false, info(5.0)).unwrap();
        let Err(NotReady::Refused(told)) = camera.ready(&colour, &depth, &options) else {
            panic!("{part}");
        };
        assert!(told.contains(part) && told.contains("found"), "{told}");
    }
    let mut camera = CameraState::new(topics());
    assert!(camera.take_info(false, vec![0, 1, 0, 0, 1]).is_err());
    assert!(camera.take_transforms(&[7]).is_err());
}
