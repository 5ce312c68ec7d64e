// Reads a file written by `stillpoint run ... --record` with the libraries of Foxglove and Lichtblick: npm's @mcap/core,
// @foxglove/rosmsg and @foxglove/rosmsg2-serialization. Prints messages per topic; exit code 1 if one cannot be decoded.
//
//     node check_record.mjs RUN.mcap
import { readFile } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const bytes = await readFile(process.argv[2]);
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, size) => new Uint8Array(bytes.buffer, bytes.byteOffset + Number(offset), Number(size)),
};
const reader = await McapIndexedReader.Initialize({ readable });
const readers = new Map();
for (const schema of reader.schemasById.values())
  readers.set(schema.id, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
const counts = new Map();
let refused = 0;
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  try {
    readers.get(channel.schemaId).readMessage(message.data);
  } catch (e) {
    refused++;
    console.log(`${channel.topic}: ${e.message}`);
  }
  counts.set(channel.topic, (counts.get(channel.topic) ?? 0) + 1);
}
for (const [topic, count] of [...counts].sort()) console.log(`${String(count).padStart(6)} ${topic}`);
process.exit(refused > 0 || counts.size === 0 ? 1 : 0);
