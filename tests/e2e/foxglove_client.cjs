// A client of the viewers' protocol that knows nothing of robo: the protocol's own, with its reader of ROS's texts.
// It subscribes, calls, sets, publishes, and prints what came of it as JSON.
"use strict";

const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader, MessageWriter } = require("@foxglove/rosmsg2-serialization");
const WebSocket = require("ws");

const [, , address, robot, subprotocol] = process.argv;
const PATIENCE = 40_000; // ms

const socket = new WebSocket(address, [subprotocol]);
const client = new FoxgloveClient({ ws: socket });
const channels = new Map();
const services = new Map();
const messages = new Map(); // by subscription, those that nobody has taken
const waiting = new Set();
const failures = [];
const found = {};

function definitions(schema) {
  return parse(schema, { ros2: true });
}

// Resolves once a condition holds that anything which comes may bring about.
function until(what, condition) {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new Error(`never: ${what}`)), PATIENCE);
    const look = () => {
      const value = condition();
      if (value !== undefined && value !== false) {
        clearTimeout(timer);
        waiting.delete(look);
        resolve(value);
      }
    };
    waiting.add(look);
    look();
  });
}

function changed() {
  for (const look of [...waiting]) {
    look();
  }
}

client.on("error", (error) => failures.push(String(error)));
client.on("serverInfo", (info) => (found.capabilities = info.capabilities, changed()));
client.on("advertise", (news) => (news.forEach((one) => channels.set(one.topic, one)), changed()));
client.on("advertiseServices", (news) => (news.forEach((one) => services.set(one.name, one)), changed()));
client.on("message", ({ subscriptionId, data }) => {
  messages.set(subscriptionId, [...(messages.get(subscriptionId) ?? []), data]);
  changed();
});

async function subscribed(topic) {
  const channel = await until(topic, () => channels.get(topic));
  const reader = new MessageReader(definitions(channel.schema));
  const subscription = client.subscribe(channel.id);
  return { channel, subscription, next: async () => {
    const data = await until(`a message of ${topic}`, () => messages.get(subscription)?.shift());
    return reader.readMessage(data);
  } };
}

async function called(name) {
  const service = await until(name, () => services.get(name));
  const writer = new MessageWriter(definitions(service.request.schema));
  const answer = new Promise((resolve) => client.on("serviceCallResponse", resolve));
  const data = new DataView(writer.writeMessage({}).buffer);
  client.sendServiceCallRequest({ serviceId: service.id, callId: 1, encoding: "cdr", data });
  const response = await answer;
  return new MessageReader(definitions(service.response.schema)).readMessage(response.data);
}

function parameters(ask) {
  return new Promise((resolve) => {
    client.on("parameterValues", (values) => values.id === "asked" && resolve(values.parameters));
    ask();
  });
}

async function main() {
  await until("server info", () => found.capabilities);
  found.subprotocol = socket.protocol;

  const odometry = await subscribed(`/${robot}/odom`);
  found.odometry = (await odometry.next()).header.frame_id;
  found.schemaName = odometry.channel.schemaName;

  found.latched = (await (await subscribed(`/${robot}/tf_static`)).next()).transforms.length;

  found.service = await called(`/${robot}/reset_distance`);

  const name = `/${robot}/safety_monitor.max_speed`;
  found.before = await parameters(() => client.getParameters([name], "asked"));
  client.subscribeParameterUpdates([name]);
  client.setParameters([{ name, value: 0.75 }], "asked");
  found.after = await new Promise((resolve) => {
    client.on("parameterValues", ({ parameters: [one] }) => one.value === 0.75 && resolve(one));
  });

  const graph = new Promise((resolve) => client.on("connectionGraphUpdate", resolve));
  client.subscribeConnectionGraph();
  found.publishers = (await graph).publishedTopics.find((one) => one.name === `/${robot}/odom`).publisherIds;

  // What is published comes back where it is subscribed, and the robot drives.
  const command = await subscribed(`/${robot}/cmd_vel_joy`);
  const writer = new MessageWriter(definitions(command.channel.schema));
  const { topic, schemaName } = command.channel;
  const drive = client.advertise({ topic, encoding: "cdr", schemaName });
  const beats = setInterval(() => {
    client.sendMessage(drive, writer.writeMessage({ linear: { x: 0.3, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0 } }));
  }, 50);
  // The zeros with which a client before this one was stopped may come first.
  found.published = 0;
  while (found.published === 0) {
    found.published = (await command.next()).linear.x;
  }
  let speed = 0;
  while (speed < 0.2) {
    speed = (await odometry.next()).twist.twist.linear.x;
  }
  clearInterval(beats);
  found.drives = true;
  found.failures = failures;
  console.log(JSON.stringify(found));
  client.close();
}

main().then(() => process.exit(0), (error) => {
  console.error(error, failures, found);
  process.exit(1);
});
