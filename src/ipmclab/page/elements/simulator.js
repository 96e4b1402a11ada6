// The view of simulate.js as an element of NiceGUI.
export default {
  template: "<div></div>",
  props: { options: Object },
  mounted() {
    this.view = new window.LabSimulate.View(this.$el, this.options, (state) => this.$emit("asked", state));
  },
  methods: {
    changes() {
      return this.view.changes;
    },
    set_runs(runs) {
      this.view.setRuns(runs);
    },
  },
  unmounted() {
    this.view.destroy();
  },
};
