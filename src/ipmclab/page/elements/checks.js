// Some of a list, by boxes. "said" tells, at every change, what is chosen and of what.
export default {
  template: `
    <fieldset class="lab-checks"><legend>{{ options.label }}</legend>
      <label v-for="(text, name) in options.choices"><input type="checkbox" autocomplete="off" :checked="mine.includes(name)" @change="pick(name, $event.target.checked)">
        <span>{{ text }} <small v-if="options.notes[name]">{{ options.notes[name] }}</small></span></label>
      <p v-if="message" role="alert" class="lab-bad">{{ message }}</p>
    </fieldset>`,
  props: { options: Object, chosen: Array, heard: Number, message: String },
  data() {
    return { mine: [...this.chosen], clicks: this.heard };
  },
  watch: {
    // What the server says before it has heard the last click is older than that.
    chosen: { deep: true, handler(now) { if (this.heard === this.clicks) { this.mine = [...now]; this.say(); } } },
    options: { deep: true, handler() { this.say(); } },
  },
  methods: {
    pick(name, on) {
      this.mine = this.mine.filter((one) => one !== name);
      if (on) this.mine.push(name);
      this.$emit("chosen", this.mine, ++this.clicks);
      this.say();
    },
    say() {
      this.$emit("said", { chosen: this.mine, offered: Object.keys(this.options.choices) });
    },
  },
};
