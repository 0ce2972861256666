// CRC of `bits` (16 at most), most significant bit first, as canopen's SDO block transfer calls it.
exports.crc = (bits, reflected, polynomial, polynomialHigh, initial, initialHigh, final, finalHigh, data) => {
    const mask = 2 ** bits - 1, top = 2 ** (bits - 1);
    let value = initial;
    for (const byte of data) {
        value ^= byte << (bits - 8);
        for (let i = 0; i < 8; i++) value = ((value & top ? (value << 1) ^ polynomial : value << 1) & mask) >>> 0;
    }
    const result = Buffer.alloc(2);
    result.writeUInt16BE((value ^ final) & mask);
    return result;
};
