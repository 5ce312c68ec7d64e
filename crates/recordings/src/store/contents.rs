//! Index of the messages in the files of a recording.

use super::{Channel, HEAD, Place, Slot, full_name, head_of, header_stamp, is_looked_into};
use crate::budget::{self, LONGEST_NAME, MOST_CHANNELS, MOST_OF_A_TYPE, Remarks, one_line};
use crate::odometry::odometry_sample;
use std::collections::BTreeMap;
use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, from_bytes};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Count {
    pub(crate) messages: u64,
    /// Times at which the first and the last were received, ns.
    pub(crate) first: i64,
    pub(crate) last: i64,
    /// Number of sensor messages that are unreadable or not finite.
    pub(crate) unsound: u64,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Contents {
    pub(crate) channels: Vec<Channel>,
    /// One per channel.
    pub(crate) counts: Vec<Count>,
    /// Messages of parsed types, in file order.
    pub(crate) slots: Vec<Slot>,
    pub(crate) remarks: Remarks,
    /// Channel index by name, type and encoding.
    index: BTreeMap<(String, String, u8), u32>,
    of_type: BTreeMap<String, usize>,
    bytes: u64,
    topics_beyond: u64,
    messages_beyond: u64,
    /// Number of chunks beyond the budget, and the offset of the first.
    chunks_beyond: u64,
    first_beyond: u64,
    /// Slot indices grouped by channel, and the start of each group.
    by_channel: Vec<u32>,
    begins: Vec<u32>,
}

impl Contents {
    pub(crate) fn of(bytes: u64) -> Self {
        Self {
            bytes,
            ..Self::default()
        }
    }

    /// The index of a channel, which is added if it is new: a channel may be declared repeatedly. `None` beyond the budget.
    pub(crate) fn channel(
        &mut self,
        topic: &str,
        type_name: &str,
        format: Option<Format>,
    ) -> Option<u32> {
        if topic.len().max(type_name.len()) > LONGEST_NAME {
            self.remarks.add(|| {
                format!(
                    "a topic whose name has {} bytes and its type's {}, more than {LONGEST_NAME}, is left out",
                    topic.len(),
                    type_name.len()
                )
            });
            return None;
        }
        let (topic, type_name) = (one_line(topic), full_name(&one_line(type_name)));
        let kind = match format {
            None => 0,
            Some(Format::Ros1) => 1,
            Some(_) => 2,
        };
        let key = (topic, type_name, kind);
        if let Some(index) = self.index.get(&key) {
            return Some(*index);
        }
        let of_type = self.of_type.get(&key.1).copied().unwrap_or(0);
        let one_by_one = is_looked_into(&key.1) && !key.1.starts_with("std_msgs/");
        if self.channels.len() >= MOST_CHANNELS || (one_by_one && of_type >= MOST_OF_A_TYPE) {
            self.topics_beyond += 1;
            return None;
        }
        let index = self.channels.len() as u32;
        *self.of_type.entry(key.1.clone()).or_default() += 1;
        self.channels.push(Channel {
            topic: key.0.clone(),
            type_name: key.1.clone(),
            format,
        });
        self.counts.push(Count {
            messages: 0,
            first: i64::MAX,
            last: i64::MIN,
            unsound: 0,
        });
        self.index.insert(key, index);
        Some(index)
    }

    /// Number of bytes of a channel's messages that [`Self::message`] needs.
    pub(crate) fn head_of(&self, channel: u32) -> usize {
        head_of(&self.channels[channel as usize].type_name)
    }

    /// Counts a message, and indexes it if its type is parsed. `head` are its first bytes.
    pub(crate) fn message(&mut self, channel: u32, logged: i64, head: &[u8], place: Place) {
        let declared = &self.channels[channel as usize];
        let count = &mut self.counts[channel as usize];
        count.messages += 1;
        count.first = logged.min(count.first);
        count.last = logged.max(count.last);
        if !is_looked_into(&declared.type_name) {
            return;
        }
        if u64::from(place.len) > super::largest_message(&declared.type_name) {
            self.remarks.add(|| {
                format!(
                    "a message of {} bytes on {} is left out",
                    place.len, declared.topic
                )
            });
        } else if self.slots.len() as u64 >= budget::most_slots(self.bytes) {
            self.messages_beyond += 1;
        } else {
            // A message longer than its head is not checked, and is unusual.
            let whole = place.len as usize <= head.len();
            count.unsound += u64::from(whole && is_unsound(declared, head));
            self.slots.push(Slot {
                channel,
                logged,
                stamp: header_stamp(declared, &head[..head.len().min(HEAD)]),
                place,
            });
        }
    }

    /// Examines individually compressed messages. `heads` returns the first bytes of one.
    pub(crate) fn look_again<E>(
        &mut self,
        mut head: impl FnMut(&Slot, usize) -> Result<Vec<u8>, E>,
    ) -> Result<(), E> {
        self.counts.iter_mut().for_each(|c| c.unsound = 0);
        for slot in &mut self.slots {
            let declared = &self.channels[slot.channel as usize];
            let head = head(slot, head_of(&declared.type_name))?;
            slot.stamp = header_stamp(declared, &head[..head.len().min(HEAD)]);
            self.counts[slot.channel as usize].unsound += u64::from(is_unsound(declared, &head));
        }
        Ok(())
    }

    /// Adds the contents of another file of the recording.
    pub(crate) fn merge(&mut self, other: Self) {
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.topics_beyond += other.topics_beyond;
        self.messages_beyond += other.messages_beyond;
        if self.chunks_beyond == 0 {
            self.first_beyond = other.first_beyond;
        }
        self.chunks_beyond += other.chunks_beyond;
        let mut index = Vec::with_capacity(other.channels.len());
        for (channel, count) in other.channels.iter().zip(&other.counts) {
            let here = self.channel(&channel.topic, &channel.type_name, channel.format);
            if let Some(here) = here {
                let known = &mut self.counts[here as usize];
                known.messages += count.messages;
                known.first = known.first.min(count.first);
                known.last = known.last.max(count.last);
                known.unsound += count.unsound;
            }
            index.push(here);
        }
        for slot in other.slots {
            if self.slots.len() as u64 >= budget::most_slots(self.bytes) {
                self.messages_beyond += 1;
            } else if let Some(channel) = index[slot.channel as usize] {
                self.slots.push(Slot { channel, ..slot });
            }
        }
        self.remarks.merge(other.remarks);
    }

    /// Reports that the file is truncated at an offset.
    pub(crate) fn cut(&mut self, at: u64) {
        self.remarks
            .add(|| format!("the file is cut off or damaged at byte {at}: what is before is used"));
    }

    pub(crate) fn chunk_beyond(&mut self, at: u64) {
        if self.chunks_beyond == 0 {
            self.first_beyond = at;
        }
        self.chunks_beyond += 1;
    }

    /// Reports the excess, and groups messages by channel. Nothing may be added afterwards.
    pub(crate) fn finish(&mut self) {
        let (topics, messages) = (self.topics_beyond, self.messages_beyond);
        if topics > 0 {
            self.remarks.add(|| {
                format!("{topics} topics are left out: more than {MOST_CHANNELS} in all, or {MOST_OF_A_TYPE} of one type")
            });
        }
        if messages > 0 {
            self.remarks.add(|| {
                format!("{messages} messages are left out: there are more than a recording of this size has")
            });
        }
        let (chunks, first) = (self.chunks_beyond, self.first_beyond);
        if chunks > 0 {
            self.remarks.add(|| {
                format!("{chunks} chunks, the first at byte {first}, are left out: they unpack to far more than recordings do")
            });
        }
        for (channel, count) in self.channels.iter().zip(&self.counts) {
            if count.unsound > 0 {
                self.remarks.add(|| {
                    format!(
                        "topic {}: {} of {} samples do not read or hold values that are no numbers (NaN), and are left out",
                        channel.topic, count.unsound, count.messages
                    )
                });
            }
        }
        let mut begins = vec![0_u32; self.channels.len() + 1];
        for slot in &self.slots {
            begins[slot.channel as usize + 1] += 1;
        }
        for i in 1..begins.len() {
            begins[i] += begins[i - 1];
        }
        let mut next = begins.clone();
        self.by_channel = vec![0; self.slots.len()];
        for (i, slot) in self.slots.iter().enumerate() {
            let place = &mut next[slot.channel as usize];
            self.by_channel[*place as usize] = i as u32;
            *place += 1;
        }
        self.begins = begins;
    }

    pub(crate) fn slots_of(&self, channel: u32) -> impl Iterator<Item = &Slot> {
        let channel = channel as usize;
        let bounds = self.begins.get(channel).zip(self.begins.get(channel + 1));
        let of_channel = bounds.map_or(&[][..], |(from, to)| {
            &self.by_channel[*from as usize..*to as usize]
        });
        of_channel.iter().map(|i| &self.slots[*i as usize])
    }
}

fn is_unsound(channel: &Channel, bytes: &[u8]) -> bool {
    let Some(format) = channel.format else {
        return false;
    };
    match channel.type_name.as_str() {
        "sensor_msgs/msg/Imu" => from_bytes::<ros::Imu<'_>>(bytes, format).map_or(true, |m| {
            let (rate, force) = (&m.angular_velocity, &m.linear_acceleration);
            let values = [rate.x, rate.y, rate.z, force.x, force.y, force.z];
            !values.iter().all(|v| v.is_finite())
        }),
        "nav_msgs/msg/Odometry" => from_bytes::<ros::Odometry<'_>>(bytes, format)
            .map_or(true, |m| odometry_sample(&m, 0.0).is_none()),
        _ => false,
    }
}
