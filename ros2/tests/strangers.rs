//! A single forged packet can exhaust a middleware that trusts its claims.

use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::time::{Duration, Instant};
use stillpoint_ros2::bus::{Bus, Quality, Reach, Writer};
use stillpoint_ros2::names::NodeName;

const TYPE: &str = "sensor_msgs/msg/Image";
/// Submessages of RTPS (v2.5, 9.4.5.1.1).
const HEARTBEAT: u8 = 0x07;
const GAP: u8 = 0x08;
const DATA_FRAG: u8 = 0x16;
const FLAGS: u8 = 1;
/// A sequence number far beyond any message.
const FAR: i64 = 1 << 62;

fn node(name: &str) -> NodeName {
    NodeName {
        namespace: "/".to_owned(),
        name: name.to_owned(),
    }
}

fn sequence_number(n: i64) -> Vec<u8> {
    let halves = [((n >> 32) as u32), (n & 0xffff_ffff) as u32];
    halves.iter().flat_map(|h| h.to_le_bytes()).collect()
}

/// A packet of the writer's participant with one submessage for all readers.
fn packet(writer: [u8; 16], kind: u8, more: &[&[u8]]) -> Vec<u8> {
    let body = more.concat();
    let length = (body.len() as u16).to_le_bytes();
    [
        b"RTPS\x02\x03\x01\x12".as_slice(),
        &writer[..12],
        &[kind, FLAGS],
        &length,
        &body,
    ]
    .concat()
}

/// Packets with impossible claims, with different numbers each time.
fn forged(writer: [u8; 16], i: i64) -> [Vec<u8>; 3] {
    let ends = [[0; 4].as_slice(), &writer[12..]].concat();
    let count = (1_000_000 + i as i32).to_le_bytes();
    let heartbeat = [sequence_number(1), sequence_number(FAR + i)].concat();
    let gap = [sequence_number(1000 + i), sequence_number(FAR)].concat();
    // No further flags, 28 bytes to the payload; the first of many fragments of 1024 bytes, of 2 GB.
    let head = [0, 0, 28, 0];
    let mut fragment = [sequence_number(1000 + i), vec![1, 0, 0, 0, 1, 0, 0, 4]].concat();
    fragment.extend((i32::MAX).to_le_bytes());
    fragment.extend([0; 1024]);
    [
        packet(writer, HEARTBEAT, &[&ends, &heartbeat, &count]),
        packet(writer, GAP, &[&ends, &gap, &[0; 4]]),
        packet(writer, DATA_FRAG, &[&head, &ends, &fragment]),
    ]
}

fn join(name: &str, domain: u16) -> Bus {
    let reach = Reach {
        domain,
        local_only: true,
    };
    Bus::join(&node(name), reach, BTreeMap::new()).unwrap()
}

/// Waits until a writer has a reader, with a timeout.
fn meet(nodes: [&mut Bus; 2], writer: &Writer) {
    let end = Instant::now() + Duration::from_secs(15);
    while writer.subscribers() == 0 && Instant::now() < end {
        nodes[0].wait(Duration::from_millis(20));
        nodes[1].wait(Duration::from_millis(20));
    }
    assert!(writer.subscribers() > 0, "nobody was found");
}

fn resident_megabytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024)
}

#[test]
fn forged_packets_disrupt_neither_traffic_nor_memory() {
    // Ports below the ephemeral range, of a domain that robots rarely use.
    let domain = 60 + (std::process::id() % 40) as u16;
    let mut ours = join("ours", domain);
    let reader = ours.subscribe("/image", TYPE, Quality::DEFAULT).unwrap();
    let mut theirs = join("theirs", domain);
    let writer = theirs.publish("/image", TYPE, Quality::DEFAULT).unwrap();
    meet([&mut ours, &mut theirs], &writer);
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let before = resident_megabytes();
    for i in 0..300 {
        for forged in forged(writer.id(), i) {
            // Sent to both nodes, since either may have the lower port.
            for port in [11, 13] {
                let to = ("127.0.0.1", 7400 + 250 * domain + port);
                stranger.send_to(&forged, to).unwrap();
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    // A camera that joins later is still discovered and received.
    let mut camera = join("camera", domain);
    let later = camera.publish("/image", TYPE, Quality::DEFAULT).unwrap();
    meet([&mut ours, &mut camera], &later);
    let message = [0, 1, 0, 0, 7, 0, 0, 0];
    let end = Instant::now() + Duration::from_secs(15);
    let mut heard = None;
    while heard.is_none() && Instant::now() < end {
        assert!(later.send(&message));
        ours.wait(Duration::from_millis(50));
        heard = reader.take();
    }
    assert_eq!(heard.map(|r| r.bytes), Some(message.to_vec()));
    if let (Some(before), Some(after)) = (before, resident_megabytes()) {
        assert!(after < before + 200, "{before} MB before, {after} MB after");
    }
}
