// An independent CANopen device, driven by lines of JSON.
// In:  {id, data}: a frame from the bus; {ask, upload: [index, sub, type]} or {ask, download: [index, sub, type, value]};
//      {ask, command: "start" | "stop" | "preoperational"}: NMT, to all.
// Out: {id, data}: a frame to the bus; {answer, value} or {answer, error}; {pdo, values}; {emergency}; {heartbeat, state}.
'use strict';
const { createInterface } = require('readline');
const { Device, DataType, Eds } = require('canopen');

const [file, remote, own] = process.argv.slice(2); // our EDS with node ids filled in; our node id; the peer's
const tell = (line) => process.stdout.write(JSON.stringify(line) + '\n');
const node = Number(remote);

const device = new Device({ id: Number(own) });
const eds = Eds.fromFile(file);
device.eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node);
device.eds.addHeartbeatConsumer(node, 2000);
device.eds.addEmcyConsumer(0x80 + node);
let index = 0x2000;
for (const pdo of eds.getTransmitPdos()) {
    const dataObjects = pdo.dataObjects.map((o) => device.eds.addEntry(index++, {
        parameterName: o.parameterName, dataType: o.dataType, pdoMapping: true,
    }));
    device.eds.addReceivePdo({ cobId: pdo.cobId, dataObjects });
}

device.addListener('message', ({ id, data }) => tell({ id, data: Buffer.from(data).toString('hex') }));
device.pdo.addListener('pdo', ({ cobId, dataObjects }) => tell({
    pdo: cobId, values: Object.fromEntries(dataObjects.map((o) => [o.parameterName, Number(o.value)])),
}));
device.emcy.addListener('emergency', ({ em }) => tell({ emergency: em.code, register: em.register }));
device.nmt.addListener('heartbeat', ({ deviceId, state }) => tell({ heartbeat: deviceId, state }));
device.start();
device.nmt.startNode();
tell({ ready: eds.getTransmitPdos().map((pdo) => pdo.cobId) });

const actions = {
    upload: ([index, subIndex, type]) =>
        device.sdo.upload({ deviceId: node, index, subIndex, dataType: DataType[type], timeout: 2000 }),
    download: ([index, subIndex, type, data]) =>
        device.sdo.download({ deviceId: node, index, subIndex, data, dataType: DataType[type], timeout: 2000 }),
    command: async (what) => ({
        start: () => device.nmt.startNode(node),
        stop: () => device.nmt.stopNode(node),
        preoperational: () => device.nmt.enterPreOperational(node),
        reset: () => device.nmt.resetNode(node),
    })[what](),
};

createInterface({ input: process.stdin }).on('line', (text) => {
    const line = JSON.parse(text);
    if (line.id !== undefined) {
        const data = Buffer.from(line.data, 'hex');
        device.receive({ id: line.id, data, len: data.length });
        return;
    }
    const what = Object.keys(actions).find((key) => line[key] !== undefined);
    actions[what](line[what]).then(
        (value) => tell({ answer: line.ask, value: value === undefined ? null : value }),
        (error) => tell({ answer: line.ask, error: String(error.message || error) }),
    );
}).on('close', () => process.exit(0));
