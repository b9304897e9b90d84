// A recording of the robot, read in JavaScript with the MCAP library alone, whole or cut off:
//   npm install @mcap/core && node read-recording.mjs 000.mcap
// prints a line a beat: its number, both wheels' actions, what the board was given, milliseconds.
import { createReadStream } from "node:fs";
import { McapStreamReader } from "@mcap/core";

const topics = new Map();
const reader = new McapStreamReader();
reading: for await (const bytes of createReadStream(process.argv[2])) {
  reader.append(bytes);
  try {
    for (let record; (record = reader.nextRecord()); ) {
      if (record.type === "Channel") topics.set(record.id, record.topic);
      if (record.type !== "Message" || !topics.get(record.channelId).endsWith("/drive")) continue;
      const beat = JSON.parse(new TextDecoder().decode(record.data));
      console.log(beat.sequence, beat.action_left, beat.action_right, beat.board_m1, beat.decide_ms);
    }
  } catch (error) {
    console.error(`the rest is damaged: ${error.message}`);
    break reading;
  }
}
