// The main job as node-opcua sees it: browse, learn, approve, deploy, execute, and the events that tell of it.
// One argument: a JSON file with the address, the certificate, the users and the demonstrations. Prints one JSON line.
const fs = require("fs");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const {
  AttributeIds, ClientMonitoredItem, ClientSubscription, DataType, MessageSecurityMode, OPCUAClient,
  SecurityPolicy, StatusCodes, TimestampsToReturn, UserTokenType, VariantArrayType, constructEventFilter,
} = require("node-opcua-client");

const plan = JSON.parse(fs.readFileSync(process.argv[2]));
const text = (value) => ({ dataType: DataType.String, value });
const number = (value) => ({ dataType: DataType.UInt32, value });

async function signedIn(user, work) {
  const client = OPCUAClient.create({
    applicationName: "node", applicationUri: plan.uri, certificateFile: plan.certificate, privateKeyFile: plan.key,
    securityMode: MessageSecurityMode.SignAndEncrypt, securityPolicy: SecurityPolicy.Basic256Sha256,
    endpointMustExist: false, connectionStrategy: { maxRetry: 0 },
    clientCertificateManager: new OPCUACertificateManager({ rootFolder: plan.folder, automaticallyAcceptUnknownCertificate: true }),
  });
  await client.connect(plan.url);
  const session = await client.createSession({ type: UserTokenType.UserName, userName: user, password: plan.password });
  try {
    const spaces = await session.readNamespaceArray();
    return await work(session, spaces.indexOf("urn:opcua-skill:instances"));
  } finally {
    await session.close();
    await client.disconnect();
  }
}

async function call(session, index, object, method, inputArguments) {
  const result = await session.call({ objectId: `ns=${index};s=${object}`, methodId: `ns=${index};s=${object}/${method}`, inputArguments });
  if (!result.statusCode.isGood()) throw new Error(`${method}: ${result.statusCode.name}`);
  return result.outputArguments.map((variant) => variant.value);
}

async function jobEnds(session, index, object, jobId) {
  for (let tries = 0; tries < 600; tries++) {
    const [report] = await call(session, index, object, "GetJob", [text(jobId)]);
    if (["Completed", "Failed", "Aborted"].includes(report.state)) return report;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error(`job ${jobId} does not end`);
}

async function structureTypes(session, index) {
  const method = `ns=${index};s=SkillLibrary/LearnFromDemonstration`;
  const found = await session.getArgumentDefinition(method);
  return { demonstration: found.inputArguments[2].dataType, options: found.inputArguments[3].dataType };
}

async function main() {
  const told = { client: "node-opcua" };
  await signedIn("teacher", async (session, index) => {
    const below = await session.browse(`ns=${index};s=SkillLibrary`);
    told.browsed = below.references.map((reference) => reference.browseName.name);
    const types = await structureTypes(session, index);
    const demonstrations = [];
    for (const one of plan.demonstrations) demonstrations.push(await session.constructExtensionObject(types.demonstration, one));
    const options = await session.constructExtensionObject(types.options, { preset: "recommended", rejectOutliers: true });
    const [jobId, state, version] = await call(session, index, "SkillLibrary", "LearnFromDemonstration", [
      text(plan.skill), text("gluing"),
      { dataType: DataType.ExtensionObject, arrayType: VariantArrayType.Array, value: demonstrations },
      { dataType: DataType.ExtensionObject, value: options },
    ]);
    told.learned = state === "Running" ? (await jobEnds(session, index, "SkillLibrary", jobId)).skillVersion : version;
  });
  await signedIn("engineer", async (session, index) => {
    const messages = [];
    const subscription = ClientSubscription.create(session, { requestedPublishingInterval: 100, requestedMaxKeepAliveCount: 10, publishingEnabled: true });
    const filter = constructEventFilter(["EventType", "Message", "SourceName", "Severity"]);
    const item = ClientMonitoredItem.create(subscription, { nodeId: "i=2253", attributeId: AttributeIds.EventNotifier }, { queueSize: 100, filter }, TimestampsToReturn.Both);
    await new Promise((resolve, reject) => { item.once("initialized", resolve); item.once("err", (why) => reject(new Error(why))); });
    item.on("changed", (fields) => messages.push(fields[1].value.text));
    const [description] = await call(session, index, "SkillLibrary", "GetSkill", [text(plan.skill), number(told.learned)]);
    const digest = Buffer.from(JSON.parse(description).modelDigest, "hex");
    const approval = [text(plan.skill), number(told.learned), { dataType: DataType.ByteString, value: digest }, text("looks good")];
    [told.approved] = await call(session, index, "SkillLibrary", "Approve", approval);
    [told.deployed] = await call(session, index, "SkillLibrary", "Deploy", [text(plan.skill), number(told.learned), text("ws1")]);
    await signedIn("mes", async (other) => {
      const station = "Machines/ws1";
      const [jobId] = await call(other, index, station, "ExecuteSkill", [text(plan.skill), text(""), { dataType: DataType.Int32, value: 2 }]);
      const report = await jobEnds(other, index, station, jobId);
      Object.assign(told, { job: report.state, samples: report.samples });
      const refused = await other.call({ objectId: `ns=${index};s=SkillLibrary`, methodId: `ns=${index};s=SkillLibrary/Approve`, inputArguments: approval });
      told.refused = refused.statusCode.name;
    });
    for (let tries = 0; tries < 100 && !messages.some((one) => one.includes("ExecuteSkill")); tries++) await new Promise((resolve) => setTimeout(resolve, 100));
    told.events = messages;
    const secured = await session.read({ nodeId: "i=3708", attributeId: AttributeIds.Value });
    told.secured = secured.value.value.map((one) => [one.clientUserIdOfSession, one.authenticationMechanism, one.encoding, one.transportProtocol]);
    const sessions = await session.read({ nodeId: "i=3707", attributeId: AttributeIds.Value });
    told.called = sessions.value.value.map((one) => one.callCount.totalCount);
    const part = await session.read({ nodeId: "i=2255", attributeId: AttributeIds.Value, indexRange: "0" });
    told.part = Array.from(part.value.value);
    await subscription.terminate();
  });
  console.log(JSON.stringify(told));
}

main().then(() => process.exit(0), (error) => { console.error(error.stack || error); process.exit(1); });
