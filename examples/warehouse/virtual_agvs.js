// Virtual AGVs of npm's vda-5050-lib at the stations of virtual_agvs.json:
//   node virtual_agvs.js 1883          all of them in one process
//   node virtual_agvs.js 1883 F1 F2    these alone
// Give NODE_PATH where the library is installed elsewhere than here.
const { AgvController, VirtualAgvAdapter } = require("vda-5050-lib");
const stations = require("./virtual_agvs.json");

const [port, ...named] = process.argv.slice(2);
for (const serialNumber of named.length ? named : Object.keys(stations)) {
  const { manufacturer, version, x, y, node } = stations[serialNumber];
  const agv = new AgvController(
    { manufacturer, serialNumber },
    {
      interfaceName: "uagv",
      transport: { brokerUrl: `mqtt://127.0.0.1:${port}`, heartbeat: 5, reconnectPeriod: 500 },
      vdaVersion: version,
    },
    {
      agvAdapterType: VirtualAgvAdapter,
      publishStateInterval: 5000,
      publishVisualizationInterval: 500,
    },
    {
      initialPosition: { mapId: "hall", x, y, theta: 0, lastNodeId: node },
      vehicleSpeed: 2,
    },
  );
  agv.start().then(() => console.log(`${serialNumber} is online`));
}
