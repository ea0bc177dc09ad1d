// One virtual AGV of npm's vda-5050-lib:
//   node virtual_agv.js PORT VERSION MANUFACTURER SERIAL MAP X Y NODE SPEED
const { AgvController, VirtualAgvAdapter } = require("vda-5050-lib");

const [port, version, manufacturer, serialNumber, mapId, x, y, lastNodeId, speed] =
  process.argv.slice(2);
const agv = new AgvController(
  { manufacturer, serialNumber },
  {
    interfaceName: "uagv",
    transport: { brokerUrl: `mqtt://127.0.0.1:${port}`, heartbeat: 5, reconnectPeriod: 500 },
    vdaVersion: version,
  },
  { agvAdapterType: VirtualAgvAdapter, publishStateInterval: 5000, publishVisualizationInterval: 500 },
  {
    initialPosition: { mapId, x: Number(x), y: Number(y), theta: 0, lastNodeId },
    vehicleSpeed: Number(speed),
  },
);
agv.start().then(() => console.log("started"));
