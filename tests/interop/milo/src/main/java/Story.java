import static org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.Unsigned.uint;

import java.io.FileInputStream;
import java.io.InputStream;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.KeyFactory;
import java.security.KeyPair;
import java.security.PrivateKey;
import java.security.cert.CertificateFactory;
import java.security.cert.X509Certificate;
import java.security.spec.PKCS8EncodedKeySpec;
import java.util.ArrayList;
import java.util.Base64;
import java.util.HexFormat;
import java.util.List;
import java.util.Properties;
import java.util.concurrent.CopyOnWriteArrayList;
import org.eclipse.milo.opcua.sdk.client.OpcUaClient;
import org.eclipse.milo.opcua.sdk.client.identity.UsernameProvider;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaMonitoredItem;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaSubscription;
import org.eclipse.milo.opcua.stack.core.AttributeId;
import org.eclipse.milo.opcua.stack.core.NodeIds;
import org.eclipse.milo.opcua.stack.core.encoding.binary.OpcUaBinaryDecoder;
import org.eclipse.milo.opcua.stack.core.encoding.binary.OpcUaBinaryEncoder;
import org.eclipse.milo.opcua.stack.core.security.CertificateValidator;
import org.eclipse.milo.opcua.stack.core.security.SecurityPolicy;
import org.eclipse.milo.opcua.stack.core.types.builtin.ByteString;
import org.eclipse.milo.opcua.stack.core.types.builtin.DateTime;
import org.eclipse.milo.opcua.stack.core.types.builtin.ExtensionObject;
import org.eclipse.milo.opcua.stack.core.types.builtin.LocalizedText;
import org.eclipse.milo.opcua.stack.core.types.builtin.NodeId;
import org.eclipse.milo.opcua.stack.core.types.builtin.QualifiedName;
import org.eclipse.milo.opcua.stack.core.types.builtin.Variant;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.UByte;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.UShort;
import org.eclipse.milo.opcua.stack.core.types.enumerated.BrowseDirection;
import org.eclipse.milo.opcua.stack.core.types.enumerated.BrowseResultMask;
import org.eclipse.milo.opcua.stack.core.types.enumerated.MessageSecurityMode;
import org.eclipse.milo.opcua.stack.core.types.structured.Argument;
import org.eclipse.milo.opcua.stack.core.types.structured.BrowseDescription;
import org.eclipse.milo.opcua.stack.core.types.structured.CallMethodRequest;
import org.eclipse.milo.opcua.stack.core.types.structured.CallMethodResult;
import org.eclipse.milo.opcua.stack.core.types.structured.ContentFilter;
import org.eclipse.milo.opcua.stack.core.types.structured.EventFilter;
import org.eclipse.milo.opcua.stack.core.types.structured.ReferenceDescription;
import org.eclipse.milo.opcua.stack.core.types.structured.SimpleAttributeOperand;

import io.netty.buffer.ByteBuf;
import io.netty.buffer.ByteBufUtil;
import io.netty.buffer.Unpooled;

/** The main job as Eclipse Milo sees it. One argument: a properties file. Prints one line of JSON. */
public final class Story {
  private static final Properties plan = new Properties();

  interface Work {
    void with(OpcUaClient client, int index) throws Exception;
  }

  public static void main(String[] arguments) throws Exception {
    try (InputStream file = new FileInputStream(arguments[0])) {
      plan.load(file);
    }
    String skill = plan.getProperty("skill");
    StringBuilder told = new StringBuilder("{\"client\": \"milo\"");
    long[] version = {0};
    signedIn("teacher", (client, index) -> {
      told.append(", \"browsed\": ").append(strings(browsed(client, node(index, "SkillLibrary"), NodeIds.HasComponent)));
      Variant[] learned = call(client, index, "SkillLibrary", "LearnFromDemonstration",
          new Variant(skill), new Variant("gluing"), new Variant(demonstrations(client, index)), new Variant(options(client, index)));
      version[0] = ((Number) learned[2].value()).longValue();
      if ("Running".equals(learned[1].value())) {
        version[0] = jobEnds(client, index, "SkillLibrary", (String) learned[0].value()).version;
      }
      told.append(", \"learned\": ").append(version[0]);
    });
    signedIn("engineer", (client, index) -> {
      List<String> messages = new CopyOnWriteArrayList<>();
      OpcUaSubscription subscription = subscribed(client, messages);
      Variant number = new Variant(uint(version[0]));
      String description = (String) call(client, index, "SkillLibrary", "GetSkill", new Variant(skill), number)[0].value();
      String hex = description.replaceAll("(?s).*\"modelDigest\"\\s*:\\s*\"([0-9a-f]+)\".*", "$1");
      Variant[] approval = {new Variant(skill), number, new Variant(ByteString.of(HexFormat.of().parseHex(hex))), new Variant("looks good")};
      told.append(", \"approved\": \"").append(call(client, index, "SkillLibrary", "Approve", approval)[0].value()).append('"');
      call(client, index, "SkillLibrary", "Deploy", new Variant(skill), number, new Variant("ws1"));
      signedIn("mes", (other, same) -> {
        String station = "Machines/ws1";
        String job = (String) call(other, same, station, "ExecuteSkill", new Variant(skill), new Variant(""), new Variant(2))[0].value();
        Report report = jobEnds(other, same, station, job);
        told.append(", \"job\": \"").append(report.state).append("\", \"samples\": ").append(report.samples);
        String name = result(other, same, "SkillLibrary", "Approve", approval).getStatusCode().toString();
        told.append(", \"refused\": \"").append(name.replaceAll(".*name=(\\w+).*", "$1").replace("_", "")).append('"');
      });
      for (int tries = 0; tries < 100 && messages.stream().noneMatch(one -> one.contains("ExecuteSkill")); tries++) {
        Thread.sleep(100);
      }
      told.append(", \"events\": ").append(strings(messages));
      subscription.delete();
    });
    System.out.println(told.append('}'));
    System.exit(0);
  }

  private static void signedIn(String user, Work work) throws Exception {
    X509Certificate certificate;
    try (InputStream file = new FileInputStream(plan.getProperty("certificate"))) {
      certificate = (X509Certificate) CertificateFactory.getInstance("X.509").generateCertificate(file);
    }
    String pem = Files.readString(Path.of(plan.getProperty("key"))).replaceAll("-----[A-Z ]+-----", "").replaceAll("\\s", "");
    PrivateKey key = KeyFactory.getInstance("RSA").generatePrivate(new PKCS8EncodedKeySpec(Base64.getDecoder().decode(pem)));
    KeyPair pair = new KeyPair(certificate.getPublicKey(), key);
    OpcUaClient client = OpcUaClient.create(
        plan.getProperty("url"),
        offered -> offered.stream()
            .filter(one -> SecurityPolicy.Basic256Sha256.getUri().equals(one.getSecurityPolicyUri()))
            .filter(one -> one.getSecurityMode() == MessageSecurityMode.SignAndEncrypt)
            .findFirst(),
        transport -> {},
        config -> config
            .setApplicationName(LocalizedText.english("milo"))
            .setApplicationUri(plan.getProperty("uri"))
            .setKeyPair(pair)
            .setCertificate(certificate)
            .setCertificateChain(new X509Certificate[] {certificate})
            .setCertificateValidator(new CertificateValidator.InsecureCertificateValidator())
            .setIdentityProvider(new UsernameProvider(user, plan.getProperty("password")))
            .setRequestTimeout(uint(60_000)));
    client.connect();
    try {
      work.with(client, client.getNamespaceTable().getIndex("urn:opcua-skill:instances").intValue());
    } finally {
      client.disconnect();
    }
  }

  private static NodeId node(int index, String path) {
    return new NodeId(index, path);
  }

  private static CallMethodResult result(OpcUaClient client, int index, String object, String method, Variant... inputs) throws Exception {
    CallMethodRequest request = new CallMethodRequest(node(index, object), node(index, object + "/" + method), inputs);
    return client.call(List.of(request)).getResults()[0];
  }

  private static Variant[] call(OpcUaClient client, int index, String object, String method, Variant... inputs) throws Exception {
    CallMethodResult result = result(client, index, object, method, inputs);
    if (!result.getStatusCode().isGood()) {
      throw new IllegalStateException(method + ": " + result.getStatusCode());
    }
    return result.getOutputArguments();
  }

  private static List<String> browsed(OpcUaClient client, NodeId from, NodeId kind) throws Exception {
    List<String> names = new ArrayList<>();
    for (ReferenceDescription one : references(client, from, kind)) {
      names.add(one.getBrowseName().name());
    }
    return names;
  }

  private static ReferenceDescription[] references(OpcUaClient client, NodeId from, NodeId kind) throws Exception {
    BrowseDescription wanted = new BrowseDescription(from, BrowseDirection.Forward, kind, true, uint(0), uint(BrowseResultMask.All.getValue()));
    return client.browse(wanted).getReferences();
  }

  /** Returns the binary encoding of the structure that an argument of LearnFromDemonstration is declared to be. */
  private static NodeId encoding(OpcUaClient client, int index, int place) throws Exception {
    NodeId method = node(index, "SkillLibrary/LearnFromDemonstration");
    for (ReferenceDescription one : references(client, method, NodeIds.HasProperty)) {
      if ("InputArguments".equals(one.getBrowseName().name())) {
        NodeId property = one.getNodeId().toNodeIdOrThrow(client.getNamespaceTable());
        ExtensionObject[] declared = (ExtensionObject[]) client.readValue(0.0, org.eclipse.milo.opcua.stack.core.types.enumerated.TimestampsToReturn.Neither, property).value().value();
        Argument argument = (Argument) declared[place].decode(client.getStaticEncodingContext());
        return references(client, argument.getDataType(), NodeIds.HasEncoding)[0].getNodeId().toNodeIdOrThrow(client.getNamespaceTable());
      }
    }
    throw new IllegalStateException("the method has no arguments");
  }

  private static ExtensionObject[] demonstrations(OpcUaClient client, int index) throws Exception {
    NodeId encoding = encoding(client, index, 2);
    List<ExtensionObject> all = new ArrayList<>();
    for (String file : plan.getProperty("demonstrations").split(",")) {
      List<String> lines = Files.readAllLines(Path.of(file));
      int dimension = lines.get(0).split(",").length - 2;
      Double[] times = new Double[lines.size()];
      Double[] positions = new Double[lines.size() * dimension];
      Boolean[] triggers = new Boolean[lines.size()];
      for (int row = 0; row < lines.size(); row++) {
        String[] cells = lines.get(row).split(",");
        times[row] = Double.parseDouble(cells[0]);
        for (int axis = 0; axis < dimension; axis++) {
          positions[row * dimension + axis] = Double.parseDouble(cells[1 + axis]);
        }
        triggers[row] = cells[dimension + 1].equals("1");
      }
      ByteBuf buffer = Unpooled.buffer();
      OpcUaBinaryEncoder encoder = new OpcUaBinaryEncoder(client.getStaticEncodingContext());
      encoder.setBuffer(buffer);
      encoder.encodeString(null, Path.of(file).getFileName().toString());
      encoder.encodeByte(null, UByte.valueOf(dimension));
      encoder.encodeDoubleArray(null, times);
      encoder.encodeDoubleArray(null, positions);
      encoder.encodeBooleanArray(null, triggers);
      encoder.encodeString(null, "foreign");
      encoder.encodeString(null, "interop");
      encoder.encodeDateTime(null, DateTime.now());
      all.add(ExtensionObject.of(ByteString.of(ByteBufUtil.getBytes(buffer)), encoding));
    }
    return all.toArray(new ExtensionObject[0]);
  }

  private static ExtensionObject options(OpcUaClient client, int index) throws Exception {
    ByteBuf buffer = Unpooled.buffer();
    OpcUaBinaryEncoder encoder = new OpcUaBinaryEncoder(client.getStaticEncodingContext());
    encoder.setBuffer(buffer);
    encoder.encodeString(null, "recommended");
    encoder.encodeUInt16(null, UShort.valueOf(0));
    encoder.encodeDouble(null, 0.0);
    encoder.encodeString(null, "");
    encoder.encodeUInt16(null, UShort.valueOf(0));
    encoder.encodeString(null, "");
    encoder.encodeBoolean(null, true);
    encoder.encodeDouble(null, 0.0);
    encoder.encodeUInt32(null, uint(0));
    return ExtensionObject.of(ByteString.of(ByteBufUtil.getBytes(buffer)), encoding(client, index, 3));
  }

  record Report(String state, long version, long samples) {}

  private static Report jobEnds(OpcUaClient client, int index, String object, String job) throws Exception {
    for (int tries = 0; tries < 600; tries++) {
      ExtensionObject raw = (ExtensionObject) call(client, index, object, "GetJob", new Variant(job))[0].value();
      OpcUaBinaryDecoder decoder = new OpcUaBinaryDecoder(client.getStaticEncodingContext());
      decoder.setBuffer(Unpooled.wrappedBuffer(((ByteString) raw.getBody()).bytesOrEmpty()));
      decoder.decodeString(null);
      decoder.decodeString(null);
      String state = decoder.decodeString(null);
      decoder.decodeDouble(null);
      decoder.decodeString(null);
      long version = decoder.decodeUInt32(null).longValue();
      decoder.decodeString(null);
      decoder.decodeString(null);
      decoder.decodeDateTime(null);
      decoder.decodeDateTime(null);
      decoder.decodeString(null);
      decoder.decodeString(null);
      decoder.decodeDoubleArray(null);
      decoder.decodeDoubleArray(null);
      long samples = decoder.decodeUInt32(null).longValue();
      if (List.of("Completed", "Failed", "Aborted").contains(state)) {
        return new Report(state, version, samples);
      }
      Thread.sleep(100);
    }
    throw new IllegalStateException("the job does not end");
  }

  private static OpcUaSubscription subscribed(OpcUaClient client, List<String> messages) throws Exception {
    OpcUaSubscription subscription = new OpcUaSubscription(client);
    subscription.setPublishingInterval(100.0);
    subscription.create();
    SimpleAttributeOperand message = new SimpleAttributeOperand(
        NodeIds.BaseEventType, new QualifiedName[] {new QualifiedName(0, "Message")}, AttributeId.Value.uid(), null);
    EventFilter filter = new EventFilter(new SimpleAttributeOperand[] {message}, new ContentFilter(null));
    OpcUaMonitoredItem item = OpcUaMonitoredItem.newEventItem(NodeIds.Server, filter);
    item.setEventValueListener((heard, fields) -> messages.add(((LocalizedText) fields[0].value()).text()));
    subscription.addMonitoredItem(item);
    subscription.synchronizeMonitoredItems();
    return subscription;
  }

  private static String strings(List<String> values) {
    StringBuilder text = new StringBuilder("[");
    for (String value : values) {
      text.append(text.length() > 1 ? ", " : "").append('"').append(value.replace("\\", "\\\\").replace("\"", "\\\"")).append('"');
    }
    return text.append(']').toString();
  }
}
